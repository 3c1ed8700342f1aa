"""Plateaus of a trace of raw readings under changing weights, found without being told of any."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.estimation.stretches import true_runs
from hdbench.records.trace import FloatArray

# share of the whole range by which two halves of a window may differ on a plateau, and two
# plateaus before they are two: a staircase of up to a hundred equal steps has larger ones
_SAME_SHARE = 0.004
# the same in standard deviations of a window's mean
_SAME_STDS = 5.0
# shortest window, samples: fewer do not tell noise from a step
_MIN_WINDOW = 4


# samples looked at around each: a glitch of up to three of them leaves their median alone
_WINDOW = 9
# samples at either end of the sorted window that do not count for what is usual there
_TRIM = 3
# distance in noise standard deviations that chance does not reach in a day of samples, and in
# spans of the neighbours: a moving or swinging weight stays within a few of these
_NOISES, _SPANS = 12.0, 6.0
# equal readings in a row of a converter with noise: by chance once in 1e9 where half repeat
_STUCK = 30


@dataclass(frozen=True, slots=True)
class Plateau:
    """One load's readings."""

    # where its average begins and ends, s
    start_s: float
    end_s: float
    # mean and standard deviation of the samples averaged, unit of the trace
    mean: float
    std: float
    # samples averaged
    n: int
    # slope over the average, unit per s
    slope_per_s: float
    # lag-1 autocorrelation of the samples averaged
    autocorrelation: float
    # times of glitches and of stuck samples between its ends, s
    glitches_at_s: tuple[float, ...]
    stuck_at_s: tuple[float, ...]
    # whether stuck samples are in the average, because more than half of the plateau stood still
    stuck_kept: bool = False


@dataclass(frozen=True, slots=True)
class Staircase:
    """All plateaus of a trace, and the samples that none may use."""

    # in the order of time
    plateaus: tuple[Plateau, ...]
    # times of all glitches and of all stuck samples, s
    glitches_at_s: tuple[float, ...]
    stuck_at_s: tuple[float, ...]
    # noise from sample to sample, unit of the trace
    noise_std: float


def find_plateaus(time_s: FloatArray, reading: FloatArray, least_s: float = 3.0) -> Staircase:
    """Find where the reading stands still between changes of load.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Time, s, strictly increasing.
    reading : ndarray, shape (n,)
        Raw readings; NaN where missing.
    least_s : float
        Shortest plateau, s, above 0.

    Returns
    -------
    Staircase

    Raises
    ------
    ValueError
        If the two have different lengths or `least_s` is not above 0.

    Notes
    -----
    Glitches are left out first, stuck samples of each average. A sample is steady where the means
    of the two windows beside it, each a third of `least_s`, differ by less than five standard
    deviations of such a difference, or by less than 0.4 % of the range of the whole trace.
    Neighbouring steady stretches of one level are one plateau; those shorter than `least_s` are
    passed over.
    """
    if time_s.shape != reading.shape or not least_s > 0.0:
        raise ValueError(f"{time_s.shape} times, {reading.shape} readings, least {least_s!r} s")
    glitch, stuck = find_glitches(reading), find_stuck(reading)
    used = np.isfinite(reading) & ~glitch
    noise = _noise_std(np.where(used, reading, np.nan))
    kept = np.flatnonzero(used)
    t, x = time_s[kept], reading[kept]
    found: list[tuple[int, int]] = []
    if len(x) >= 3 * _MIN_WINDOW:
        window = max(_MIN_WINDOW, int(least_s / 3.0 / float(np.median(np.diff(t)))))
        limit = _limit(x, noise, window)
        found = _joined(true_runs(_steady(x, window, limit)), x, limit)
    out = []
    for start, end in found:
        if t[end - 1] - t[start] >= least_s * 2.0 / 3.0:
            own = kept[start:end]
            free = own[~stuck[own]]
            # a plateau that stood still as a whole has no other reading: it is kept and marked
            chosen = free if len(free) >= max(_MIN_WINDOW, len(own) // 2) else own
            out.append(_plateau(chosen, time_s, reading, glitch, stuck))
    return Staircase(
        tuple(out),
        tuple(float(v) for v in time_s[glitch]),
        tuple(float(v) for v in time_s[stuck]),
        noise,
    )


def _limit(x: FloatArray, noise: float, window: int) -> float:
    span = float(np.ptp(x))
    return max(_SAME_STDS * noise * float(np.sqrt(2.0 / window)), _SAME_SHARE * span)


def _steady(x: FloatArray, window: int, limit: float) -> NDArray[np.bool_]:
    """Return where the means before and behind a sample agree; at the ends, of shorter windows."""
    n = len(x)
    total = np.concatenate([[0.0], np.cumsum(x - x[0])])
    places = np.arange(n)
    left, right = np.maximum(places - window, 0), np.minimum(places + window, n)
    before = np.maximum(places - left, 1)
    behind = right - places
    mean_before = (total[places] - total[left]) / before
    mean_behind = (total[right] - total[places]) / behind
    # short windows at the ends are noisier: they do not decide
    short = (places - left < _MIN_WINDOW) | (behind < _MIN_WINDOW)
    return np.asarray(short | (np.abs(mean_behind - mean_before) <= limit))


def _joined(runs: list[tuple[int, int]], x: FloatArray, limit: float) -> list[tuple[int, int]]:
    """Join neighbouring stretches of one level: a swing between them was no change of load."""
    out: list[tuple[int, int]] = []
    for start, end in runs:
        if end - start < _MIN_WINDOW:
            continue
        if out:
            first, last = out[-1]
            apart = abs(float(np.median(x[start:end])) - float(np.median(x[first:last])))
            between = x[last:start]
            level = float(np.median(x[first:last]))
            moved = float(np.max(np.abs(between - level))) if len(between) else 0.0
            if apart <= limit and moved <= 10.0 * limit:
                out[-1] = (first, end)
                continue
        out.append((start, end))
    return out


def _plateau(
    chosen: NDArray[np.intp],
    time_s: FloatArray,
    reading: FloatArray,
    glitch: NDArray[np.bool_],
    stuck: NDArray[np.bool_],
) -> Plateau:
    t, x = time_s[chosen], reading[chosen]
    inside = (time_s >= t[0]) & (time_s <= t[-1])
    offset = t - t.mean()
    left = x - x.mean()
    spread = float(left @ left)
    return Plateau(
        float(t[0]),
        float(t[-1]),
        float(x.mean()),
        float(x.std(ddof=1)),
        len(x),
        float(offset @ left) / float(offset @ offset),
        float(left[1:] @ left[:-1]) / spread if spread > 0.0 else 0.0,
        tuple(float(v) for v in time_s[inside & glitch]),
        tuple(float(v) for v in time_s[inside & stuck]),
        bool(stuck[chosen].any()),
    )


def _noise_std(x: FloatArray) -> float:
    """Return the standard deviation of the noise from sample to sample.

    Notes
    -----
    ``1.4826 median |x(k+1) - x(k)| / sqrt(2)``: steps and glitches do not move the median.
    """
    step = np.abs(np.diff(x[np.isfinite(x)]))
    return 1.4826 * float(np.median(step)) / np.sqrt(2.0) if len(step) else 0.0


def find_glitches(x: FloatArray) -> NDArray[np.bool_]:
    """Return which samples jump away from their neighbours and back.

    Notes
    -----
    A sample is a glitch when it is further from the median of nine samples around it than twelve
    noise standard deviations *and* six times the span of the middle three of them: at a change of
    load the span is wide.
    """
    found = np.zeros(len(x), dtype=bool)
    there = np.flatnonzero(np.isfinite(x))
    if len(there) < _WINDOW:
        return found
    y = x[there]
    half = _WINDOW // 2
    padded = np.concatenate([y[half:0:-1], y, y[-2 : -half - 2 : -1]])
    around = np.sort(np.lib.stride_tricks.sliding_window_view(padded, _WINDOW), axis=1)
    span = around[:, -1 - _TRIM] - around[:, _TRIM]
    off = np.abs(y - around[:, half])
    found[there] = (off > _NOISES * _noise_std(y)) & (off > _SPANS * span) & (off > 0.0)
    return found


def find_stuck(x: FloatArray) -> NDArray[np.bool_]:
    """Return which samples belong to a converter that stood still."""
    found = np.zeros(len(x), dtype=bool)
    same = np.diff(x) == 0.0
    if not len(same) or float(same.mean()) > 0.5:
        return found
    for start, end in true_runs(same):
        if end - start >= _STUCK:
            found[start + 1 : end + 1] = True
    return found
