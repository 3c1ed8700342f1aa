"""The continuous channels of the bench: torque through flexspline and bridge, tacho, current."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.plant.bridge import GaugeBridge, place_gauges
from hdbench.plant.drivetrain import AsymmetricFriction
from hdbench.plant.effects import (
    Effect,
    OutputFriction,
    effect_torque_nm,
)
from hdbench.plant.fixture import Mount
from hdbench.plant.plantschema import MotorSpec
from hdbench.plant.servo import HoldMotion, motor_current_a
from hdbench.plant.truemotion import PlantMotion
from hdbench.profile.schema import HarmonicParameters, ProfileData
from hdbench.records.trace import FloatArray

__all__ = ["AnalogueChannels"]

# Motor speed over which dry friction at the motor shaft turns its sign, rad/s: far below any speed
# that a plan asks for.
MOTOR_FRICTION_TRANSITION_RAD_S = 1.0


@dataclass(frozen=True, slots=True)
class AnalogueChannels:
    """What the node's inputs see, in volts, for a given motion.

    Parameters
    ----------
    profile : ProfileData
        The bench.
    bridge : GaugeBridge
        Strain gauges and amplifier.
    mesh_ripple : tuple of HarmonicParameters
        The profile's ripple that is torque and not misplaced gauges.
    motor : MotorSpec
        Friction at the motor shaft.
    effects : tuple of Effect
        What the plant has beyond its model.
    """

    profile: ProfileData
    bridge: GaugeBridge
    mesh_ripple: tuple[HarmonicParameters, ...]
    motor: MotorSpec
    effects: tuple[Effect, ...]

    @classmethod
    def build(
        cls,
        profile: ProfileData,
        motor: MotorSpec,
        effects: tuple[Effect, ...],
    ) -> AnalogueChannels:
        """Return the channels of `profile`, gauges placed so that they leave its ripple."""
        bridge, rest = place_gauges(profile.sensor, profile.model.ripple)
        return cls(profile, bridge, rest, motor, effects)

    def volts(self, time_s: FloatArray, motion: HoldMotion, mount: Mount) -> FloatArray:
        """Return torque, tacho and current channel."""
        full = self._motion(time_s, motion, mount)
        servo, daq = self.profile.servo, self.profile.daq
        current = motor_current_a(servo, motion.acceleration_rad_s2, self._motor_friction_nm(full))
        return np.stack(
            (
                self._torque_v(full, mount),
                motion.velocity_rad_s / self.profile.tacho.gain_rad_s_per_v,
                current * (daq.range_v / servo.max_current_a),
            )
        )

    def _motion(self, time_s: FloatArray, motion: HoldMotion, mount: Mount) -> PlantMotion:
        """Return the motion with the torque that the flexspline transmits."""
        ratio = self.profile.drive.gear_ratio
        if mount.locked:
            still = np.zeros_like(time_s)
            angle = np.full_like(time_s, -mount.position_rad)
            load = mount.load.torque_nm(time_s - mount.since_s)
            return PlantMotion(time_s, angle, still, still, still, load)
        output = motion.angle_rad / ratio
        misalignment = self.profile.model.misalignment
        transmitted = motion.acceleration_rad_s2 * (self.profile.drive.load_inertia_kg_m2 / ratio)
        transmitted += misalignment.amplitude_nm * np.cos(output + misalignment.phase_rad)
        return PlantMotion(
            time_s,
            motion.angle_rad,
            motion.velocity_rad_s,
            output,
            motion.velocity_rad_s / ratio,
            transmitted,
        )

    def _torque_v(self, full: PlantMotion, mount: Mount) -> FloatArray:
        """Return the amplified bridge output with its zero."""
        drive, sensor = self.profile.drive, self.profile.sensor
        turning = drive.flexspline == "turning" and not mount.locked
        relative = full.motor_angle_rad * (1.0 + 1.0 / drive.gear_ratio if turning else 1.0)
        torque = full.transmitted_nm + effect_torque_nm(self.effects, full)
        for part in self.mesh_ripple:
            torque += part.amplitude_nm * np.cos(part.order * relative + part.phase_rad)
        if mount.locked:
            torque *= sensor.gain_nm_per_v / mount.gain_nm_per_v
        zero_v = self.profile.model.zero_nm / sensor.gain_nm_per_v
        return self.bridge.output_v(torque, relative) + zero_v

    def _motor_friction_nm(self, full: PlantMotion) -> FloatArray:
        """Return friction at the motor shaft: its own and the output bearing's, geared down."""
        speed = full.motor_velocity_rad_s
        dry = np.arctan(speed / MOTOR_FRICTION_TRANSITION_RAD_S) * (2.0 / math.pi)
        friction = self.motor.coulomb_nm * dry + self.motor.viscous_nm_s_per_rad * speed
        for effect in self.effects:
            if isinstance(effect, OutputFriction | AsymmetricFriction):
                friction += effect.torque_nm(full) / self.profile.drive.gear_ratio
        return friction
