"""The forms in which readings are searched for hysteresis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hdbench.model import Cause, Motion
from hdbench.model.statics import preloaded_motion
from hdbench.records.trace import FloatArray

__all__ = ["loop_forms"]

Columns = Callable[[Motion, Mapping[str, float]], FloatArray]

# what the forms are marked by
_PRELOADED = "after a preload"
_STRAIGHT = {
    "after a preload, loading straight": True,
    "after a preload, unloading straight": False,
}


def loop_forms(loop: Cause) -> tuple[Cause, ...]:
    """Return the forms of hysteresis.

    Parameters
    ----------
    loop : Cause
        Hysteresis without its gain: one column.

    Returns
    -------
    tuple of Cause
        From rest; after a preload; and after a preload with one branch straight, as where a gain
        was set by the readings of the other: the loop is all on one side of it.
    """
    after = replace(loop, columns=_preloaded(loop), locked_to=f"load, {_PRELOADED}")
    sided = tuple(
        replace(loop, columns=_one_sided(after, falling), locked_to=f"load, {form}")
        for form, falling in _STRAIGHT.items()
    )
    return (loop, after, *sided)


def _preloaded(cause: Cause) -> Columns:
    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        longer, readings = preloaded_motion(motion)
        return cause.columns(longer, shape)[readings]

    return columns


def _one_sided(cause: Cause, falling: bool) -> Columns:
    """Return the columns of a loop whose `falling` branch, or the other, holds all of it."""

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        whole = cause.columns(motion, shape)[:, 0]
        load = motion.load_torque_nm
        torque = np.zeros(len(motion)) if load is None else load
        begun = np.zeros(len(motion), dtype=bool) if motion.starts is None else motion.starts
        return _branch(whole, torque, begun, falling)[:, None]

    return columns


def _branch(
    loop: FloatArray, torque: FloatArray, begun: NDArray[np.bool_], falling: bool
) -> FloatArray:
    """Return twice the distance of one branch from the chord of its loop, 0 on the other.

    Zero in an experiment that changes the sign of its torque: there the loop has no such chord.
    """
    first = np.flatnonzero(begun | (np.arange(len(torque)) == 0))
    number = np.cumsum(begun | (np.arange(len(torque)) == 0)) - 1
    size = np.abs(torque)
    least, most = np.minimum.reduceat(size, first), np.maximum.reduceat(size, first)
    low, high = (_mean_where(loop, size == end[number], first) for end in (least, most))
    both = np.minimum.reduceat(torque, first) * np.maximum.reduceat(torque, first) < 0.0
    reach = most - least
    usable = ~both & (reach > 0.0)
    rise = np.where(usable, high - low, 0.0) / np.where(usable, reach, 1.0)
    chord = low[number] + rise[number] * (size - least[number])
    # a load that is read twice belongs to the branch before
    change = np.diff(size, prepend=size[0])
    change[first] = 0.0
    known = (change != 0.0) | (np.arange(len(size)) == first[number])
    at = np.maximum.accumulate(np.where(known, np.arange(len(size)), 0))
    down = change[at] < 0.0
    return np.asarray(np.where((down == falling) & usable[number], 2.0 * (loop - chord), 0.0))


def _mean_where(
    values: FloatArray, where: NDArray[np.bool_], first: NDArray[np.intp]
) -> FloatArray:
    """Return the mean of the values at marked places of each experiment, one in each at least."""
    total = np.add.reduceat(np.where(where, values, 0.0), first)
    return np.asarray(total / np.add.reduceat(where.astype(np.float64), first))
