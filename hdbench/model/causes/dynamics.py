"""Causes of the motion: inertia and time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.model.causes._needs import accelerates
from hdbench.model.causes._parts import no_shape, single
from hdbench.model.causes.sensor import whole_signal
from hdbench.model.definition import Cause, Parameter
from hdbench.model.delay import delayed
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["INERTIA_ERROR", "TIME_SKEW"]

# neither two channels of one converter nor a filter of a bench delay by more than this
_SLOWEST_S = 0.1
# two channels of one bench differ by 0.1 to 3 ms; no further, so that a delay stays within a
# period of the fastest ripple
_LARGEST_DELAY_S = 0.005
# below this a shift is its first term to 1e-4 at the highest frequency that 1 kHz holds
_INFINITESIMAL_S = 1e-7


def _per_inertia(motion: Motion) -> FloatArray:
    return single(motion.acceleration_rad_s2 / motion.gear_ratio)


def _skew(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    delay = shape["delay_s"]
    if abs(delay) < _INFINITESIMAL_S:
        delay = _INFINITESIMAL_S
    torque = np.where(motion.valid, whole_signal(motion), np.nan)
    return single((delayed(motion.time_s, torque, delay) - torque) / delay)


def _delay_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    del motion
    return {"delay_s": (-_LARGEST_DELAY_S, _LARGEST_DELAY_S)}


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
    equation="dt (y(t - T) - y(t)) / T, y the torque in the channel, T = dt",
    shape=(
        Parameter(
            "delay_s",
            "s",
            -0.1,
            0.1,
            "delay at which the shift is formed, T: equal to dt, of no effect where dt is small",
            default=0.0,
        ),
    ),
    linear=(Parameter("skew_s", "s", -1.0, 1.0, "delay of the torque channel, dt"),),
    locked_to="time",
    parity="odd in the rate of the torque; grows with its frequency",
    channel="acquisition",
    look_alikes=("inertia-error", "viscous-friction", "hysteresis"),
    experiment="locked sine of torque at 1, 5 and 20 Hz: the phase of a delay grows with them",
    source="the torque channel is read later than the motion",
    columns=_skew,
    harmonic=False,
    applicable=_changes,
    reach=_delay_reach,
    whole_signal=True,
)
