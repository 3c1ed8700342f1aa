"""Causes that change slowly or once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.model.causes._memory import first_order, remembered, spread_out
from hdbench.model.causes._needs import all_of, lasts, loaded
from hdbench.model.causes._parts import Computed, no_column, no_shape, single
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

# shortest time constant of a warm-up in the catalogue
_SHORTEST_S = 5.0


def _since_start(motion: Motion) -> FloatArray:
    return np.asarray(motion.time_s - motion.time_s[0])


def _step(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    return single(np.where(motion.time_s >= shape["step_time_s"], 1.0, 0.0))


def _drift(motion: Motion) -> FloatArray:
    return single(_since_start(motion))


def _warm_up(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    return single(-np.expm1(-_since_start(motion) / shape["time_constant_s"]))


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


def _creep_reach(motion: Motion) -> dict[str, tuple[float, float]]:
    steps = np.diff(motion.time_s)
    span = float(motion.time_s[-1] - motion.time_s[0])
    # faster than two samples creep is part of the gain; slower than thrice the record it is the
    # integral of the load, whatever the time constant
    return {"time_constant_s": (2.0 * float(np.median(steps)) if len(steps) else 0.0, 3.0 * span)}


COMPUTED = {
    "zero-step": Computed(_step),
    "zero-drift": Computed(no_shape(_drift)),
    "warm-up": Computed(_warm_up, lasts(_SHORTEST_S)),
    "zero-random-walk": Computed(no_column, lasts(1.0)),
    "creep": Computed(_creep, all_of(loaded, lasts(1.0)), reach=_creep_reach),
}
