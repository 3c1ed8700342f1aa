"""Causes of an extended model on the emulated bench, moving and locked."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hdbench.plant.fixture import Mount
from hdbench.plant.servo import command_rad_s, servo_loop
from hdbench.plant.timeline import AnalogueChannels
from hdbench.profile.schema import (
    HarmonicParameters,
    MisalignmentParameters,
    ModelParameters,
    ProfileData,
)
from hdbench.records.trace import FloatArray

if TYPE_CHECKING:
    from hdbench.model import BenchModel

# the emulated bench stands in a room that keeps its temperature
ROOM_C = 20.0


def with_model(profile: ProfileData, model: BenchModel) -> ProfileData:
    """Return `profile` with the baseline of `model`."""
    drive = profile.drive
    turning = drive.flexspline == "turning"
    factor = 1.0 + 1.0 / drive.gear_ratio if turning else 1.0
    ripple = tuple(
        HarmonicParameters(order=order / factor, amplitude_nm=amplitude, phase_rad=phase)
        for order, amplitude, phase in model.ripple
    )
    amplitude, phase = model.misalignment
    misalignment = MisalignmentParameters(amplitude_nm=amplitude, phase_rad=phase)
    baseline = ModelParameters(zero_nm=model.zero_nm, ripple=ripple, misalignment=misalignment)
    inertia = model.inertia_nm_s2 * drive.gear_ratio
    moved = drive.model_copy(update={"load_inertia_kg_m2": inertia})
    return profile.model_copy(update={"model": baseline, "drive": moved})


def cause_volts(
    model: BenchModel,
    channels: AnalogueChannels,
    mount: Mount,
    sample_period_s: float,
    reference_v: FloatArray,
) -> FloatArray:
    """Return what the causes of `model` add to the torque channel."""
    from hdbench.model import Motion, gauge_order_factor

    profile, ratio = channels.profile, channels.profile.drive.gear_ratio
    command = command_rad_s(profile, reference_v)
    motion = servo_loop(profile.servo).run(command, sample_period_s, 1, (0.0, 0.0, 0.0))
    angle, acceleration = motion.angle_rad[:, 0], motion.acceleration_rad_s2[:, 0]
    time_s = np.arange(len(reference_v), dtype=np.float64) * sample_period_s
    per_volt_a = profile.servo.max_current_a / profile.daq.range_v
    sampled = Motion(
        time_s=time_s,
        velocity_rad_s=motion.velocity_rad_s[:, 0],
        angle_rad=angle,
        acceleration_rad_s2=acceleration,
        output_angle_rad=angle / ratio,
        valid=np.ones(len(reference_v), dtype=bool),
        angle_source="motor_angle_rad",
        gear_ratio=ratio,
        motor_current_a=channels.volts(time_s[:, None], motion, mount)[2, :, 0] * per_volt_a,
        temperature_c=np.full(len(reference_v), ROOM_C),
        gauge_factor=gauge_order_factor(profile.drive),
        inertia_nm_s2=model.inertia_nm_s2,
    )
    return model.cause_torque_nm(sampled) / profile.sensor.gain_nm_per_v


# a weight changes within this time, and samples are at least this far apart
_TICK_S = 1e-6


class ModelCauses:
    """Causes of the model that an emulated bench follows.

    On a locked bench each weight counts with its torque at rest, from the time at which it was
    hung. A new position or direction is a new clamping, at which nothing that remembers is carried
    over.
    """

    def __init__(self, model: BenchModel | None, profile: ProfileData) -> None:
        self.model = model
        self._profile = profile
        self._volts: FloatArray = np.zeros(1)
        # weights that were hung since the lock was closed
        self._held: list[Mount] = []

    @property
    def names(self) -> list[str]:
        """Names of the causes."""
        return [] if self.model is None else [term.name for term in self.model.causes]

    def restart(self, elapsed_s: float) -> None:
        """Count time from a new acquisition, `elapsed_s` after the one before began."""
        self._held = [replace(mount, since_s=mount.since_s - elapsed_s) for mount in self._held]

    def change(self, mount: Mount) -> None:
        """Take note of what is mounted from now on."""
        if not mount.locked:
            self._held = []
            return
        if self._held and (mount.since_s <= self._held[-1].since_s or mount == self._held[-1]):
            self._held.pop()
        self._held.append(mount)

    def move(
        self,
        channels: AnalogueChannels,
        mount: Mount,
        sample_period_s: float,
        reference_v: FloatArray,
    ) -> None:
        """Compute the causes for a whole motion; those of a locked bench come by their time."""
        self._volts = np.zeros(1)
        if self.model is not None and not mount.locked:
            self._volts = cause_volts(self.model, channels, mount, sample_period_s, reference_v)

    def volts(self, stamps: NDArray[np.int64], time_s: FloatArray) -> FloatArray:
        """Return what the causes add at samples."""
        volts: FloatArray = self._volts[np.minimum(stamps, len(self._volts) - 1)]
        if self.model is None or not self._held:
            return volts
        return volts + self._locked_volts(self.model, time_s)

    def _locked_volts(self, model: BenchModel, time_s: FloatArray) -> FloatArray:
        """Return what the causes add at samples of a locked bench."""
        from hdbench.model import Motion

        steps = self._steps()
        now = self._held[-1]
        # samples that were taken before the last weight was hung see it already
        after = np.maximum(time_s, steps[-1][0] + _TICK_S * np.arange(1, len(time_s) + 1))
        time, load, position, starts = (np.array(column) for column in zip(*steps, strict=True))
        still = np.zeros(len(steps) + len(time_s))
        motion = Motion(
            time_s=np.concatenate((time, after)),
            velocity_rad_s=still,
            angle_rad=-_extended(position, now.position_rad, len(after)),
            acceleration_rad_s2=still,
            output_angle_rad=_extended(position, now.position_rad, len(after)),
            valid=np.ones(len(still), dtype=bool),
            angle_source="motor_angle_rad",
            gear_ratio=self._profile.drive.gear_ratio,
            load_torque_nm=_extended(load, now.load.after_nm, len(after)),
            motor_current_a=still,
            temperature_c=np.full(len(still), ROOM_C),
            inertia_nm_s2=model.inertia_nm_s2,
            starts=_extended(starts, 0.0, len(after)) > 0.0,
        )
        torque = model.cause_torque_nm(motion)[len(steps) :]
        return torque / self._profile.sensor.gain_nm_per_v

    def _steps(self) -> list[tuple[float, float, float, float]]:
        """Return time, torque, position and whether it begins anew, for every weight."""
        steps: list[tuple[float, float, float, float]] = []
        before: Mount | None = None
        for mount in self._held:
            anew = before is None or (before.position_rad, before.gain_nm_per_v) != (
                mount.position_rad,
                mount.gain_nm_per_v,
            )
            if before is not None and not anew and mount.since_s - _TICK_S > steps[-1][0]:
                last = before.load.after_nm
                steps.append((mount.since_s - _TICK_S, last, mount.position_rad, 0.0))
            steps.append((mount.since_s, mount.load.after_nm, mount.position_rad, float(anew)))
            before = mount
        return steps


def _extended(values: FloatArray, last: float, count: int) -> FloatArray:
    """Return `values` followed by `count` times `last`."""
    return np.concatenate((values, np.full(count, last)))
