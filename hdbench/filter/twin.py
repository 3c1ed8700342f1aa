"""The filter in Python: what runs where the C kernel was not compiled, to the same bits."""

from __future__ import annotations

import math

import numpy as np

from hdbench.filter.layout import USABLE, state_size
from hdbench.filter.twin_motion import first_bad_time, observe
from hdbench.filter.twin_recursion import Recursion
from hdbench.records import FloatArray

__all__ = ["run", "unused_state"]

_CHUNK = 2048  # samples whose transitions are held at a time; changes memory only


def run(
    model: FloatArray,
    state: FloatArray,
    samples: tuple[FloatArray, FloatArray, FloatArray, FloatArray | None],
    outputs: tuple[FloatArray, ...],
    flags: np.ndarray[tuple[int], np.dtype[np.uint8]],
    sums: FloatArray,
    /,
) -> int:
    """Filter samples in place; the C kernel's signature and its numbers.

    Notes
    -----
    ``x(k+1) = Phi x + K e``, ``P(k+1) = Q + (Phi - K C) P Phi'``,
    ``K = Phi P C' / (R + C P C')`` (report, equations 8-10), as measurement update and
    transition: the transition to a sample is done when that sample arrives, because it needs that
    sample's time.
    """
    time, velocity, torque, angle = samples
    bad = first_bad_time(state, time)
    if bad >= 0:
        return bad
    filtering = Recursion(model, state)
    for start in range(0, time.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        motion = (time[part], velocity[part], None if angle is None else angle[part])
        turn, dt = observe(state, model, motion, outputs[0][part])
        known = np.abs(torque[part]) <= USABLE
        usable = known & (np.abs(velocity[part]) <= USABLE)
        residual = np.where(usable, torque[part] - outputs[0][part], math.nan)
        rows = filtering.run(filtering.transitions(turn, dt), residual.tolist())
        for i in range(3):
            outputs[1 + i][part] = rows[i]
        outputs[4][part] = np.where(known, torque[part] - (rows[0] + rows[1]), math.nan)
        outputs[5][part], outputs[6][part] = rows[3], rows[4]
        flags[part] = rows[5]
    filtering.store(state)
    sums[:] = filtering.likelihood.sums()
    return -1


def unused_state(model: FloatArray) -> FloatArray:
    """Return the state of a filter that has seen nothing."""
    return np.zeros(state_size(int(model[0] + model[1])))
