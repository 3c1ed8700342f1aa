"""Samples of a record: what is doubtful, stretches without a gap, steady speed."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace
from hdbench.results.parts import DataFlag

# a step of time above this many median periods is a gap: jitter of a foreign log stays below
_GAP_PERIODS = 2.5


def true_runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and past-last place of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return [(first, last) for first, last in edges.reshape(-1, 2).tolist()]


def stretch_starts(time_s: FloatArray) -> NDArray[np.bool_]:
    """Return where a sample does not follow its predecessor in time.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Time, s, strictly increasing.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where the step of time exceeds 2.5 median steps.
    """
    starts = np.zeros(len(time_s), dtype=bool)
    step = np.diff(time_s)
    if len(step):
        starts[1:] = step > _GAP_PERIODS * np.median(step)
    return starts


def data_flags(trace: Trace, torque_nm: FloatArray, profile: ProfileData) -> tuple[DataFlag, ...]:
    """Return what makes a trace doubtful: missing samples, gaps in time, saturation.

    Parameters
    ----------
    trace : Trace
        The trace.
    torque_nm : ndarray, shape (n,)
        Its torque channel, N m.
    profile : ProfileData
        Range and resolution of the converter.

    Returns
    -------
    tuple of DataFlag
        Empty where nothing was found.
    """
    missing = int(np.count_nonzero(~np.isfinite(torque_nm)))
    gaps = int(np.count_nonzero(stretch_starts(trace.time_s)))
    clipped, range_v = 0, profile.daq.range_v
    if "torque_v" in trace:
        # the last two codes of the converter: a reading there may be any larger voltage
        end_v = range_v - 2.0 * (2.0 * range_v / 2**profile.daq.resolution_bits)
        clipped = int(np.count_nonzero(np.abs(trace["torque_v"]) >= end_v))
    flags = (
        DataFlag("missing-samples", missing, f"{missing} samples without a torque"),
        DataFlag("gap", gaps, f"{gaps} steps of time above 2.5 median periods"),
        DataFlag("saturation", clipped, f"{clipped} torque samples at the end of +-{range_v} V"),
    )
    return tuple(flag for flag in flags if flag.samples)


# smoothing of the velocity before it is judged: longer than a ripple period at any useful speed
_SMOOTH_S = 0.1
# a motor slower than half its fastest is on a ramp or at rest
_MOVING_SHARE = 0.5
# samples of the smoothed velocity that a search looks at: a step of 0.05 % of the record
_SEARCH_POINTS = 2000


@dataclass(frozen=True, slots=True)
class SteadyStretch:
    """Neighbouring samples at nearly constant velocity."""

    start: int
    stop: int  # one past the last
    from_s: float
    to_s: float
    velocity_rad_s: float


def smooth(time_s: FloatArray, values: FloatArray, window_s: float = _SMOOTH_S) -> FloatArray:
    """Return a moving average; missing samples are bridged for the average only."""
    known = np.isfinite(values)
    filled = np.interp(time_s, time_s[known], values[known])
    step = float(np.median(np.diff(time_s)))
    half = min(max(0, round(0.5 * window_s / step)), (len(values) - 1) // 2)
    total = np.concatenate([[0.0], np.cumsum(filled)])
    index = np.arange(len(values))
    low = np.maximum(index - half, 0)
    high = np.minimum(index + half + 1, len(values))
    return np.asarray((total[high] - total[low]) / (high - low))


def _stretch(time_s: FloatArray, velocity: FloatArray, start: int, stop: int) -> SteadyStretch:
    return SteadyStretch(
        start,
        stop,
        float(time_s[start]),
        float(time_s[stop - 1]),
        float(np.mean(velocity[start:stop])),
    )


def steady_runs(
    time_s: FloatArray,
    velocity_rad_s: FloatArray,
    *,
    settle_s: float,
    tolerance: float,
) -> tuple[SteadyStretch, ...]:
    """Return one steady stretch per direction of travel, in time order.

    Notes
    -----
    The velocity is smoothed over 0.1 s. A run lasts while it keeps its sign above half of the
    fastest velocity; its stretch reaches from the first to the last smoothed sample within
    `tolerance` of the run's median, `settle_s` left out.
    """
    if len(time_s) < 3 or not np.isfinite(velocity_rad_s).any():
        return ()
    calm = smooth(time_s, velocity_rad_s)
    fastest = float(np.max(np.abs(calm)))
    if not fastest > 0.0:
        return ()
    sign = np.where(np.abs(calm) > _MOVING_SHARE * fastest, np.sign(calm), 0.0)
    edges = np.flatnonzero(np.diff(sign)) + 1
    bounds = [0, *edges.tolist(), len(sign)]
    found = []
    for start, stop in pairwise(bounds):
        if sign[start] == 0.0:
            continue
        part = calm[start:stop]
        centre = float(np.median(part))
        good = np.abs(part - centre) <= tolerance * abs(centre)
        good &= time_s[start:stop] - time_s[start] >= settle_s
        at = np.flatnonzero(good)
        if len(at) > 2:
            found.append(_stretch(time_s, calm, start + int(at[0]), start + int(at[-1]) + 1))
    return tuple(found)


def longest_steady(
    time_s: FloatArray,
    velocity_rad_s: FloatArray,
    usable: NDArray[np.bool_],
    *,
    tolerance: float,
) -> SteadyStretch | None:
    """Return the longest stretch of usable samples whose velocity hardly changes.

    Notes
    -----
    Two pointers over the smoothed velocity with running extremes: O(n).
    """
    if not usable.any():
        return None
    calm = smooth(time_s, np.where(usable, velocity_rad_s, np.nan))
    step = max(1, math.ceil(len(calm) / _SEARCH_POINTS))
    slow = ~(np.abs(calm) > _MOVING_SHARE * float(np.max(np.abs(calm[usable]))))
    # a point stands for the samples up to the next one; all of them have to be usable
    blocked = np.logical_or.reduceat(~usable | slow, np.arange(0, len(calm), step))
    points = calm[::step]
    best, first = (0, 0), 0
    highs: deque[int] = deque()
    lows: deque[int] = deque()
    for k, value in enumerate(points):
        if blocked[k]:
            highs.clear()
            lows.clear()
            first = k + 1
            continue
        while highs and points[highs[-1]] <= value:
            highs.pop()
        while lows and points[lows[-1]] >= value:
            lows.pop()
        highs.append(k)
        lows.append(k)
        while points[highs[0]] - points[lows[0]] > tolerance * abs(
            points[highs[0]] + points[lows[0]]
        ):
            first += 1
            for ends in (highs, lows):
                if ends[0] < first:
                    ends.popleft()
        if k + 1 - first > best[1] - best[0]:
            best = (first, k + 1)
    start, stop = best[0] * step, min(best[1] * step, len(calm))
    if stop - start < 16 or not time_s[stop - 1] - time_s[start] > 2.0 * _SMOOTH_S:
        return None
    return _stretch(time_s, calm, start, stop)
