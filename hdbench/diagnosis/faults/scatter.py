"""Scatter, outliers and evidence: the statistics that all faults share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d

from hdbench.records.trace import FloatArray

# evidence that a fault needs: as for causes, a Bayes factor of 3000
ACCEPT_NATS = 8.0
# what the record shows without any statistic: a finite number that nothing reaches
CERTAIN_NATS = 700.0
# a loud stretch is judged by itself: samples over which a scatter is taken
AROUND = 400
# samples of the running mean that takes the motion out: what is left is the channels' own
FAST = 5
# this many equal samples in a row do not come from a channel with noise
STUCK = 20


def paid_nats(gain_nats: float, parameters: int, samples: int) -> float:
    """Return a gain of log likelihood less half a log of the samples for each parameter."""
    return gain_nats - 0.5 * parameters * float(np.log(samples))


def least_sigmas(samples: int) -> float:
    """Return how far out one of many samples is a fault: it has a place, a size and a length."""
    return float(np.sqrt(2.0 * (ACCEPT_NATS - paid_nats(0.0, 3, samples))))


def tail_nats(seen: float, expected: float) -> float:
    """Return the log of one over a bound of the chance to see so many where Poisson says fewer."""
    if seen <= expected or not seen:
        return 0.0
    return float(seen * np.log(seen / max(expected, 1e-12)) - seen + expected)


def bridged(values: FloatArray) -> FloatArray:
    """Return values with a straight line over what is lost; zeros where nothing is there."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.nan_to_num(values)
    at = np.arange(len(values))
    return np.interp(at, at[known], values[known])


def least_squares(design: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return the least squares' coefficients by the normal equations; 0 for empty columns."""
    size = np.sqrt(np.mean(design**2, axis=0))
    # a column that is nothing but rounding here is empty, whatever it is elsewhere
    size = np.where(size > 1e-9 * size.max(initial=0.0), size, np.inf)
    part = design / size
    gram = part.T @ part
    gram[np.diag_indices_from(gram)] *= 1.0 + 1e-10
    return np.asarray(np.linalg.lstsq(gram, part.T @ wanted, rcond=None)[0] / size)


def fast_part(values: FloatArray, size: int) -> FloatArray:
    """Return values less their running mean, twice."""
    for _ in range(2):
        values = values - uniform_filter1d(values, min(size, max(1, len(values))))
    return values


def robust_std(values: FloatArray) -> float:
    """Return half the width that holds 68.27 %: the standard deviation of normal values."""
    return float(np.quantile(np.abs(values - np.median(values)), 0.6827)) if len(values) else 0.0


def smallest_step(values: FloatArray) -> float:
    """Return the smallest difference between two values of a channel; 0 where there is none."""
    # decimals far below any converter, far above the rounding of 8-byte numbers
    levels = np.unique(np.round(values[np.isfinite(values)], 9))
    return float(np.diff(levels).min()) if len(levels) > 1 else 0.0


def mask_runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def find_outliers(
    values: FloatArray,
    valid: NDArray[np.bool_],
    readings: FloatArray,
    white: FloatArray | None = None,
    *,
    least: float = 0.0,
    even: float = 0.0,
) -> NDArray[np.bool_]:
    """Return one or two samples that stand out of the noise and of their neighbours.

    `white`, the values with white noise, stands out too; `readings` come back: else it is a step.
    They are out by more than `least`, and leave a course that is `even` times as even as that.
    """
    found = np.zeros(len(valid), dtype=bool)
    if int(valid.sum()) < AROUND:
        return found
    known, readings = np.where(valid, values, 0.0), np.where(valid, readings, 0.0)
    # an outlier lasts two samples at most: the median of five does not hold it
    off = known - median_filter(known, size=5, mode="nearest")
    sigmas = least_sigmas(len(valid))
    far = valid & (np.abs(off) > np.maximum(sigmas * _local_std(off, valid), least))
    if white is not None and far.any():
        far &= np.abs(white) > sigmas * _local_std(white, valid)
    for first, last in mask_runs(far):
        mine = slice(first, last + 1)
        beside = np.concatenate(
            [readings[max(0, first - 2) : first], readings[last + 1 : last + 3]]
        )
        low, high = float(readings[mine].min()), float(readings[mine].max())
        outside = max(low - float(beside.max()), float(beside.min()) - high)
        # it stands out of the samples on both sides by half of its size
        needed = max(0.5 * float(np.abs(off[mine]).min()), even * float(np.ptp(beside)))
        found[mine] = last - first < 2 and outside > needed
    return found


def _local_std(values: FloatArray, used: NDArray[np.bool_]) -> FloatArray:
    """Return the robust scatter around each sample, at least what the tail of all says."""
    at = np.flatnonzero(used)
    parts = np.array_split(at, max(1, len(at) // AROUND))
    centres = np.array([float(part.mean()) for part in parts])
    # a loud stretch between two quiet ones must not be judged by them: the larger neighbour counts
    wide = maximum_filter1d([robust_std(values[part]) for part in parts], 3)
    local = np.interp(np.arange(len(values)), centres, wide)
    # outliers are rare: what one sample in a hundred reaches is the distribution's own; of normal
    # values they lie beyond 2.58 standard deviations
    tail = float(np.quantile(np.abs(values[at]), 0.99)) / 2.58
    return np.asarray(np.maximum(local, max(tail, 1e-300)))


def same_noise(one: FloatArray, other: FloatArray) -> bool:
    """Return whether two channels are one, times a factor: they share their noise too."""
    good = np.isfinite(one) & np.isfinite(other)
    # fewer samples than a shortest segment tell nothing
    if int(good.sum()) < 64:
        return False
    parts = [v[good] - uniform_filter1d(v[good], FAST) for v in (one, other)]
    sizes = [float(part @ part) for part in parts]
    if not min(sizes) > 0.0:
        return False
    return bool(1.0 - float(parts[0] @ parts[1]) ** 2 / (sizes[0] * sizes[1]) < 1e-3)
