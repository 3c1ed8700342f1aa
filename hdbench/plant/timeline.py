"""Timeline of one acquisition: motion, channels, filtered samples, interruptions."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import KW_ONLY, dataclass

import numpy as np

from hdbench.plant.bridge import GaugeBridge, place_gauges
from hdbench.plant.converter import (
    HALF_LENGTH_SAMPLES,
    AnalogueSamples,
    Decimator,
    steps_per_sample,
)
from hdbench.plant.effects import (
    AsymmetricFriction,
    Effect,
    OutputFriction,
    PlantMotion,
    effect_torque_nm,
)
from hdbench.plant.fixture import Mount
from hdbench.plant.plantfile import MotorSpec
from hdbench.plant.servo import HoldMotion, command_rad_s, motor_current_a, servo_loop
from hdbench.profile.schema import HarmonicParameters, ProfileData
from hdbench.records.trace import FloatArray


class ReferenceLine:
    """One output that holds its value for a sampling period."""

    def __init__(self, values_v: FloatArray) -> None:
        self._values_v = values_v
        self._written: deque[tuple[int, float]] = deque()
        self._end: int | None = None

    @property
    def ended(self) -> bool:
        """Whether the output was zeroed for good."""
        return self._end is not None

    def values(self, first: int, count: int) -> FloatArray:
        """Return the output of `count` holds from `first` on."""
        holds = np.arange(first, first + count)
        volts = self._values_v[np.clip(holds, 0, len(self._values_v) - 1)]
        volts = np.where(holds >= 0, volts, 0.0)
        for hold, value_v in self._written:
            volts = np.where(holds >= hold, value_v, volts)
        if self._end is not None:
            volts = np.where(holds < self._end, volts, 0.0)
        return volts

    def write(self, hold: int, value_v: float) -> None:
        """Put out `value_v` from `hold` on, in place of what stood there."""
        if self._written and self._written[-1][0] == hold:
            self._written.pop()
        self._written.append((hold, value_v))

    def end(self, hold: int) -> None:
        """Zero the output from `hold` on, for good."""
        self._end = hold

    def forget(self, before: int) -> None:
        """Drop written values that ended before the hold `before`."""
        while len(self._written) > 1 and self._written[1][0] <= before:
            self._written.popleft()


# Motor speed over which dry friction at the motor shaft turns its sign, rad/s: far below any speed
# that a plan asks for.
MOTOR_FRICTION_TRANSITION_RAD_S = 1.0


@dataclass(frozen=True, slots=True)
class AnalogueChannels:
    """What the node's inputs see, in volts, for a given motion."""

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


# Holds computed at once. Blocks of one size at fixed places give the same bits however the samples
# are asked for: array functions may round differently at the end of an array.
BLOCK_HOLDS = 64


@dataclass(eq=False)
class Timeline:
    """Samples of one acquisition, in pieces of any size.

    Time 0 is the first sample; before it the bench stands at its home mark. The node hands out a
    sample when its filter has seen the `HALF_LENGTH_SAMPLES` periods after it; so an interruption
    after n samples takes effect that much after the last of them.
    """

    channels: AnalogueChannels
    sample_period_s: float
    reference_v: FloatArray
    mount: Mount
    _: KW_ONLY
    start: tuple[float, float] = (0.0, 0.0)
    host_written: bool = False

    def __post_init__(self) -> None:
        self._n_steps = steps_per_sample(self.sample_period_s)
        self._decimator = Decimator.design(self._n_steps)
        self._loop = servo_loop(self.channels.profile.servo)
        self._reference = ReferenceLine(self.reference_v)
        self._ahead = 0 if self.host_written else BLOCK_HOLDS
        self.served = 0
        self._edge = 0
        self._starts = np.array(self.start)[:, None]
        self._starts_first = 0
        self._volts = self._before(self.start)
        self._ready = np.zeros((3, 0))

    @property
    def now_hold(self) -> int:
        """Index of the hold that begins when the last sample was handed out."""
        return self.served + HALF_LENGTH_SAMPLES - 1 if self.served else 0

    @property
    def now_s(self) -> float:
        """Acquisition time at the leading edge, s."""
        return self.now_hold * self.sample_period_s

    @property
    def reference_now_v(self) -> float:
        """Motor reference at the leading edge, V."""
        return float(self.references(self.now_hold, 1)[0])

    @property
    def state_now(self) -> tuple[float, float]:
        """Wave-generator angle, rad, and motor speed, rad/s, at the leading edge."""
        return self._state(self.now_hold)

    @property
    def stopped(self) -> bool:
        """Whether the reference was zeroed for good."""
        return self._reference.ended

    def references(self, first: int, count: int) -> FloatArray:
        """Return the reference of `count` holds from `first` on."""
        return self._reference.values(first, count)

    def stop(self) -> None:
        """Zero the reference at the leading edge."""
        if not self.stopped:
            self._interrupt()
            self._reference.end(self.now_hold)

    def write(self, hold: int, value_v: float) -> None:
        """Put out another reference from a hold on; for a host-written reference only."""
        self._reference.write(max(hold, self.now_hold), value_v)

    def remount(self, mount: Mount) -> None:
        """Change lock, arm or weight at the leading edge."""
        self._interrupt()
        self.mount = mount

    def advance(self, n_samples: int) -> AnalogueSamples:
        """Return the next samples, without noise."""
        volts, angles = [np.zeros((3, 0))], [np.zeros(0)]
        first, left = self.served, n_samples
        while left > 0:
            if self._ready.shape[1] == 0:
                self._extend(left)
                continue
            take = min(left, self._ready.shape[1])
            at = self.served - self._starts_first
            volts.append(self._ready[:, :take])
            angles.append(self._starts[0, at : at + take])
            self._ready = self._ready[:, take:]
            self.served += take
            left -= take
        reference = self.references(first, n_samples)
        self._reference.forget(self.served - 1)
        torque_v, tacho_v, current_v = np.concatenate(volts, axis=1)
        return AnalogueSamples(torque_v, tacho_v, current_v, reference, np.concatenate(angles))

    def _state(self, hold: int) -> tuple[float, float]:
        """Return angle and speed at the start of `hold`."""
        angle, speed = self._starts[:, hold - self._starts_first]
        return float(angle), float(speed)

    def _before(self, start: tuple[float, float]) -> FloatArray:
        """Return the channels of the periods before the first sample."""
        angle, speed = start
        angle -= speed * HALF_LENGTH_SAMPLES * self.sample_period_s
        command = np.full(HALF_LENGTH_SAMPLES, speed)
        return self._simulate(-HALF_LENGTH_SAMPLES, command, (angle, speed, speed))[0]

    def _simulate(
        self, first: int, command: FloatArray, start: tuple[float, float, float]
    ) -> tuple[FloatArray, HoldMotion]:
        """Return channels and motion of the holds from `first` on."""
        step_s = self.sample_period_s / self._n_steps
        if self.mount.locked:
            command, start = np.zeros_like(command), (0.0, 0.0, 0.0)
        motion = self._loop.run(command, step_s, self._n_steps, start)
        steps = np.arange(len(command) * self._n_steps, dtype=np.float64)
        time_s = first * self.sample_period_s + steps.reshape(len(command), -1) * step_s
        return self.channels.volts(time_s, motion, self.mount), motion

    def _extend(self, wanted: int) -> None:
        """Compute the next block of holds and filter what it completes."""
        keep = min(self._volts.shape[1], 2 * HALF_LENGTH_SAMPLES - 1)
        holds = self._ahead or wanted + 2 * HALF_LENGTH_SAMPLES - 1 - keep
        references = self.references(self._edge - 1, holds + 1)
        command = command_rad_s(self.channels.profile, references)
        start = (*self._state(self._edge), float(command[0]))
        volts, motion = self._simulate(self._edge, command[1:], start)
        self._volts = np.concatenate((self._volts[:, -keep:], volts), axis=1)
        self._ready = self._decimator.apply(self._volts)
        starts = np.stack((motion.start_angle_rad, motion.start_velocity_rad_s))
        old = self._starts[:, self.served - self._starts_first : self._edge - self._starts_first]
        self._starts = np.concatenate((old, starts), axis=1)
        self._starts_first = self.served
        self._edge += holds

    def _interrupt(self) -> None:
        """Forget what was computed beyond the leading edge."""
        surplus = self._edge - self.now_hold
        if surplus > 0:
            self._volts = self._volts[:, :-surplus]
            self._ready = self._ready[:, :0]
            self._starts = self._starts[:, : self.now_hold - self._starts_first + 1]
            self._edge = self.now_hold
