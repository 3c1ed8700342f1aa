"""The forms in which readings are searched for hysteresis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

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
        begun = [0] if motion.starts is None else np.flatnonzero(motion.starts).tolist()
        one = np.zeros(len(motion))
        for first, last in pairwise([*begun, len(motion)]):
            one[first:last] = _branch(whole[first:last], torque[first:last], falling)
        return one[:, None]

    return columns


def _branch(loop: FloatArray, torque: FloatArray, falling: bool) -> FloatArray:
    """Return twice the distance of one branch from the chord of its loop, 0 on the other.

    Zero throughout where the torque changes its sign: there the loop has no such chord.
    """
    size = np.abs(torque)
    low, high = int(np.argmin(size)), int(np.argmax(size))
    if torque.min() < 0.0 < torque.max() or not size[high] > size[low]:
        return np.zeros(len(loop))
    chord = loop[low] + (loop[high] - loop[low]) * (size - size[low]) / (size[high] - size[low])
    # a load that is read twice belongs to the branch before
    change = np.diff(size, prepend=size[0])
    at = np.maximum.accumulate(np.where(change != 0.0, np.arange(len(size)), 0))
    down = change[at] < 0.0
    return np.asarray(np.where(down == falling, 2.0 * (loop - chord), 0.0))
