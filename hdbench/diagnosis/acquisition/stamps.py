"""Samples that are missing: no value, a step of time, or the sample before once more."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.acquisition.flags import MANY, DataFlag, mask_runs
from hdbench.records.trace import FloatArray, Trace

__all__ = ["gap_steps", "lost_flags", "repeated_rows"]

# a step longer than this many median periods is a gap: one lost sample makes 2
_GAP = 1.5
# and it stands out of the jitter of the stamps by this many standard deviations: a log with stamps
# of a host has steps beyond 1.5 periods without a loss
_JITTER_SIGMA = 8.0
# samples on each side over which a late stamp is made up for, and what is missing then, periods
_AROUND = 5
_MISSING = 0.5
# channels that tell whether a row is the one before: what the bench measured at that moment
_MEASURED = (
    "torque_nm",
    "torque_v",
    "motor_velocity_rad_s",
    "tacho_v",
    "encoder_count",
    "load_torque_nm",
    "motor_current_a",
)
_ANGLES = ("encoder_count", "motor_angle_rad")
# an angle that moves by less than this many of its smallest steps may well read the same twice
_MOVES = 5.0
# slower than this part of the usual pace the shaft may start or stop within the row
_PACE = 0.2


def gap_steps(time_s: FloatArray) -> NDArray[np.intp]:
    """Return the indices k where samples are missing between k and k + 1.

    Parameters
    ----------
    time_s : ndarray, shape (n_samples,)
        Time, s, strictly increasing.

    Returns
    -------
    ndarray of int
        Steps above 1.5 median periods that are also eight standard deviations (robust) longer
        than the median, unless the steps around make up for them.
    """
    steps = np.diff(time_s)
    if not len(steps):
        return np.zeros(0, dtype=np.intp)
    period = float(np.median(steps))
    # 68.27 % of a normal distribution lie within one standard deviation
    jitter = float(np.quantile(np.abs(steps - period), 0.6827))
    long = np.flatnonzero(steps > max(_GAP * period, period + _JITTER_SIGMA * jitter))
    if not len(long):
        return long
    # a stamp that was only late is followed by a short step: over some samples nothing is missing
    low, high = np.maximum(long - _AROUND, 0), np.minimum(long + 1 + _AROUND, len(time_s) - 1)
    at = np.arange(len(time_s) - 1)
    first, last = np.maximum(at - _AROUND, 0), np.minimum(at + 1 + _AROUND, len(time_s) - 1)
    usual = float(np.median((time_s[last] - time_s[first]) / (last - first)))
    missing = (time_s[high] - time_s[low]) / usual - (high - low)
    return np.asarray(long[missing > _MISSING])


def lost_flags(trace: Trace) -> list[DataFlag]:
    """Return samples without a value, and steps in time that lack samples.

    Parameters
    ----------
    trace : Trace
        Channels.

    Returns
    -------
    list of DataFlag
        ``missed-samples``, in order of time; one over all where there are more than twenty.
    """
    time = trace.time_s
    names = [n for n in ("torque_nm", "torque_v", "motor_velocity_rad_s", "tacho_v") if n in trace]
    missing = ~trace.valid(*names)
    flags = [
        DataFlag("missed-samples", float(time[a]), float(time[b]), b - a + 1)
        for a, b in mask_runs(missing)
    ]
    steps = np.diff(time)
    period = float(np.median(steps)) if len(steps) else 0.0
    for at in gap_steps(time):
        if _planned_pause(trace, at):
            continue
        lost = max(1, round(float(steps[at]) / period) - 1)
        flags.append(DataFlag("missed-samples", float(time[at]), float(time[at + 1]), lost))
    flags.sort(key=lambda flag: flag.from_s)
    if len(flags) <= MANY:
        return flags
    total = sum(flag.samples for flag in flags)
    return [DataFlag("missed-samples", flags[0].from_s, flags[-1].to_s, total)]


def _planned_pause(trace: Trace, at: int) -> bool:
    """Return whether a step in time lies between two stages of a plan: no sample was due there."""
    stage = trace.columns.get("stage")
    return stage is not None and bool(stage[at] != stage[at + 1])


def repeated_rows(trace: Trace) -> NDArray[np.bool_]:
    """Return rows that only repeat the one before: a missed sample that was held.

    Parameters
    ----------
    trace : Trace
        Channels.

    Returns
    -------
    ndarray of bool, shape (n_samples,)
        True where every measured channel reads as in the row before although the shaft, by the
        rows around, turns by five steps of the angle and by a fifth of its usual pace at least.
        Without an angle nothing can be said.
    """
    repeated = np.zeros(len(trace), dtype=bool)
    angles = [name for name in _ANGLES if name in trace]
    if not angles or len(trace) < 4:
        return repeated
    angle = trace[angles[0]]
    same = np.ones(len(trace) - 1, dtype=bool)
    for name in (*_MEASURED, *angles):
        if name in trace:
            same &= np.diff(trace[name]) == 0.0
    if not same.any():
        return repeated
    moves = np.diff(angle)
    sizes = np.unique(moves[np.isfinite(moves)])
    if len(sizes) < 2:
        return repeated
    turning = np.abs(moves[np.isfinite(moves) & (moves != 0.0)])
    least = max(_MOVES * float(np.diff(sizes).min()), _PACE * float(np.median(turning)))
    for first, last in mask_runs(same):
        around = (max(0, first - 1), min(len(angle) - 1, last + 2))
        turned = abs(float(angle[around[1]] - angle[around[0]]))
        # what the rows before and after have turned by, shared out over the steps between them
        if turned / (around[1] - around[0]) >= least:
            repeated[first + 1 : last + 2] = True
    return repeated
