"""Creep: a reading that follows a load slowly."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.model.causes._memory import first_order, remembered, spread_out
from hdbench.model.causes._needs import all_of, lasts, loaded
from hdbench.model.causes._parts import ratio_parameter, single
from hdbench.model.definition import Cause, Parameter
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["CREEP"]

_TIME_CONSTANT = Parameter(
    "time_constant_s", "s", 0.5, 7200.0, "time in which all but 1/e of the creep is done, T_c"
)


def _creep(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    applied = motion.applied_nm
    at, starts = remembered(motion, applied)
    torque, constant = applied[at], shape["time_constant_s"]
    step = np.diff(motion.time_s[at], prepend=motion.time_s[at[:1]])
    ratio = step / constant
    done = -np.expm1(-ratio)
    change = np.diff(torque, prepend=torque[:1])
    # share of a change, linear over the step, that has crept in by its end: 1 - done / ratio, which
    # loses its digits for a short step; its series to second order is exact to 1e-13 below 1e-4
    short = ratio < 1e-4
    late = np.where(
        short, ratio / 2.0 - ratio * ratio / 6.0, 1.0 - done / np.where(short, 1.0, ratio)
    )
    drive = (torque - change) * done + change * late
    state = first_order(np.where(starts, 0.0, 1.0 - done), np.where(starts, 0.0, drive))
    return single(spread_out(state, at, len(motion)))


def _reach(motion: Motion) -> dict[str, tuple[float, float]]:
    steps = np.diff(motion.time_s)
    span = float(motion.time_s[-1] - motion.time_s[0])
    # faster than two samples creep is part of the gain; slower than thrice the record it is the
    # integral of the load, whatever the time constant
    return {"time_constant_s": (2.0 * float(np.median(steps)) if len(steps) else 0.0, 3.0 * span)}


CREEP = Cause(
    name="creep",
    equation="g times the integral to t of exp(-(t - s) / T_c) / T_c tau(s) ds",
    shape=(_TIME_CONSTANT,),
    linear=(ratio_parameter("creep", "share of a load that is added after a long time, g"),),
    locked_to="load",
    parity="odd in load; comes and goes with the load, later than it",
    channel="sensor",
    look_alikes=("zero-drift", "warm-up", "hysteresis", "gain-error"),
    experiment="hang a weight for ten minutes, take it off and wait ten minutes",
    source="OIML R 60 (creep and its return); one viscoelastic element",
    columns=_creep,
    harmonic=False,
    applicable=all_of(loaded, lasts(1.0)),
    reach=_reach,
)
