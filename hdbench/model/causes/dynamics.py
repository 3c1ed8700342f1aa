"""Causes of the motion: inertia and time."""

from __future__ import annotations

import numpy as np

from hdbench.model.causes._needs import accelerates
from hdbench.model.causes._parts import no_shape, single
from hdbench.model.causes.sensor import whole_signal
from hdbench.model.definition import Cause, Parameter
from hdbench.model.localfit import fit_derivative
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["INERTIA_ERROR", "TIME_SKEW"]

# a quintic through seven samples: exact to sixth order, 1 % low at a sixth of the sampling rate
_DEGREE = 5
# neither two channels of one converter nor a filter of a bench delay by more than this
_SLOWEST_S = 0.1


def _per_inertia(motion: Motion) -> FloatArray:
    return single(motion.acceleration_rad_s2 / motion.gear_ratio)


def _skew(motion: Motion) -> FloatArray:
    torque = np.where(motion.valid, whole_signal(motion), np.nan)
    # the shortest window there is: seven samples
    slope = fit_derivative(motion.time_s, torque, derivative=1, degree=_DEGREE, window_s=0.0)
    # a stretch too short for a slope shows no skew
    rate = np.where(np.isnan(slope.derivative) & motion.valid, 0.0, slope.derivative)
    return single(-rate)


def _changes(motion: Motion) -> str | None:
    torque = whole_signal(motion)
    known = torque[motion.valid & np.isfinite(torque)]
    if not (len(known) > 1 and float(np.ptp(known)) > 0.0):
        return "the simulated torque is constant; needed: a torque that changes"
    period = float(np.median(np.diff(motion.time_s)))
    if period <= _SLOWEST_S:
        return None
    return f"one sample in {period:.3g} s; needed: one in {_SLOWEST_S:g} s to see a delay"


INERTIA_ERROR = Cause(
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
    applicable=accelerates,
)
TIME_SKEW = Cause(
    name="time-skew",
    equation="-dt d y / dt, y the torque in the channel",
    shape=(),
    linear=(Parameter("skew_s", "s", -1.0, 1.0, "delay of the torque channel, dt"),),
    locked_to="time",
    parity="odd in the rate of the torque; grows with its frequency",
    channel="acquisition",
    look_alikes=("inertia-error", "viscous-friction", "hysteresis"),
    experiment="locked sine of torque at 1, 5 and 20 Hz: the phase of a delay grows with them",
    source="first term of y(t - dt) in powers of dt",
    columns=no_shape(_skew),
    harmonic=False,
    applicable=_changes,
    whole_signal=True,
)
