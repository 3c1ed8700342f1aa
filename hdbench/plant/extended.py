"""What an extended model adds to the emulated bench."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdbench.plant.servo import command_rad_s, servo_loop
from hdbench.profile.schema import (
    HarmonicParameters,
    MisalignmentParameters,
    ModelParameters,
    ProfileData,
)
from hdbench.records.trace import FloatArray

if TYPE_CHECKING:
    from hdbench.model import BenchModel
    from hdbench.plant.fixture import Mount
    from hdbench.plant.torque import AnalogueChannels

__all__ = ["ROOM_C", "cause_volts", "with_model"]

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
    baseline = ModelParameters(
        zero_nm=model.zero_nm,
        ripple=ripple,
        misalignment=MisalignmentParameters(amplitude_nm=amplitude, phase_rad=phase),
    )
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
