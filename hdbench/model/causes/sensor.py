"""Causes of the sensor and of the inertia: what scales a torque that is known."""

from __future__ import annotations

import numpy as np

from hdbench.model.causes._parts import has_load, no_shape, single
from hdbench.model.definition import Cause, Parameter
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["SENSOR_CAUSES"]

# an acceleration that never leaves its own noise by this much cannot carry an inertia: the largest
# of a million normal samples lies near 5 standard deviations
_ABOVE_NOISE = 6.0


def _per_inertia(motion: Motion) -> FloatArray:
    return single(motion.acceleration_rad_s2 / motion.gear_ratio)


def _load(motion: Motion) -> FloatArray:
    load = motion.load_torque_nm
    return single(np.full(len(motion), np.nan) if load is None else load)


def _accelerates(motion: Motion) -> str | None:
    largest = float(np.abs(motion.acceleration_rad_s2[motion.valid]).max())
    if largest > _ABOVE_NOISE * motion.acceleration_noise_rad_s2:
        return None
    return (
        f"the acceleration stays within {largest:.3g} rad/s^2 at a noise of "
        f"{motion.acceleration_noise_rad_s2:.3g} rad/s^2; needed: a speed that changes faster"
    )


_INERTIA_ERROR = Cause(
    name="inertia-error",
    equation="dJ alpha_m / N",
    shape=(),
    linear=(
        Parameter("inertia_kg_m2", "kg m^2", -10.0, 10.0, "inertia that the profile lacks, dJ"),
    ),
    locked_to="acceleration",
    parity="odd in acceleration",
    channel="mechanical",
    look_alikes=("gain-error", "time-skew", "kinematic-error"),
    experiment="a fast sine of speed, and static weights",
    source="Newton's law for the load about the output",
    columns=no_shape(_per_inertia),
    harmonic=False,
    applicable=_accelerates,
)
_GAIN_ERROR = Cause(
    name="gain-error",
    equation="g load",
    shape=(),
    linear=(Parameter("gain_error", "1", -1.0, 1.0, "relative error of the sensor's gain, g"),),
    locked_to="load",
    parity="odd in load, even in speed",
    channel="sensor",
    look_alikes=("inertia-error", "cubic-nonlinearity", "position-dependent-gain"),
    experiment="static weights on at least five levels of both signs",
    source="Taghirad, CIM-TR-97-06, section 3 (gain by static loads)",
    columns=no_shape(_load),
    harmonic=False,
    applicable=has_load,
    channels=("load_torque_nm",),
)

SENSOR_CAUSES = (_INERTIA_ERROR, _GAIN_ERROR)
