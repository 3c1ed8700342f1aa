"""Sinusoids that stand above the noise of a residual."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

__all__ = ["background", "line_frequencies", "without_lines"]

# amplitude over its own standard deviation from which a peak counts as a line; its power is then
# 18 times the background: a chance of 1.5e-8 per frequency, 1e-3 in a record of 1e5 samples
_LINE_SIGMA = 6.0
# below this many cycles in the record a slow drift and a line cannot be told apart
_LOWEST_BIN = 8
# bins of the running median: far wider than a tapered line, narrow against the noise's colour
_MEDIAN_BINS = 201
# bins on either side of a peak that tell its own surroundings: outside the lobe of the window,
# inside a bump of coloured noise, which must not be taken for a line
_NEAR_BINS = range(3, 13)
_MAX_LINES = 24
_ROUNDS = 3


def background(power: FloatArray, bins: int = _MEDIAN_BINS) -> FloatArray:
    """Return the mean noise power around each bin, from medians that lines cannot move."""
    half = bins // 2
    edges = np.arange(0, len(power) + half, half)
    centres = []
    levels = []
    for low, high in zip(edges[:-1], np.minimum(edges[1:] + half, len(power)), strict=True):
        block = power[low:high]
        if len(block) < 8:
            continue
        centres.append(0.5 * (low + high - 1))
        # the median of an exponential distribution is ln 2 times its mean
        levels.append(float(np.median(block)) / np.log(2.0))
    return np.asarray(np.interp(np.arange(len(power)), centres, levels))


def _surroundings(power: FloatArray) -> FloatArray:
    """Return the mean noise power beside each bin, its own lobe left out."""
    padded = np.pad(power, _NEAR_BINS.stop, mode="reflect")
    index = np.arange(len(power)) + _NEAR_BINS.stop
    around = np.array([padded[index + sign * k] for k in _NEAR_BINS for sign in (-1, 1)])
    return np.asarray(np.median(around, axis=0) / np.log(2.0))


def line_frequencies(series: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Return the frequencies of sinusoids above six standard deviations.

    Notes
    -----
    Periodogram under a Hann window against a running median and against the median of ten bins
    on either side of the peak, whichever is higher; the place of a peak is refined from its two
    neighbours: for this window and amplitudes c-, c0, c+ at bins -1, 0, +1 the
    offset towards the larger neighbour is ``(2 r - 1) / (r + 1)``, r the ratio of it to c0.

    References
    ----------
    .. [1] D. C. Rife, G. A. Vincent, Bell Syst. Tech. J. 49 (1970) 197.
    """
    n = len(series)
    if n < 8 * _LOWEST_BIN:
        return np.zeros(0)
    amplitude = np.abs(np.fft.rfft(series * np.hanning(n) * valid))
    power = amplitude**2
    level = np.maximum(background(power), _surroundings(power))
    ratio = power / np.maximum(level, np.finfo(float).tiny)
    inner = np.arange(max(_LOWEST_BIN, 1), len(power) - 1)
    peak = (
        (ratio[inner] > _LINE_SIGMA**2 / 2.0)
        & (power[inner] >= power[inner - 1])
        & (power[inner] > power[inner + 1])
    )
    bins = inner[peak]
    bins = bins[np.argsort(ratio[bins])[::-1]][:_MAX_LINES]
    side = np.where(amplitude[bins + 1] > amplitude[bins - 1], 1, -1)
    r = amplitude[bins + side] / amplitude[bins]
    offset = np.clip(side * (2.0 * r - 1.0) / (r + 1.0), -0.5, 0.5)
    return np.asarray((bins + offset) / n)


def without_lines(series: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Return the series with its sinusoids above six standard deviations fitted and removed."""
    time = np.arange(len(series)) - 0.5 * len(series)
    clean = series
    for _ in range(_ROUNDS):
        found = line_frequencies(clean, valid)
        if not len(found):
            break
        angle = 2.0 * np.pi * np.multiply.outer(time, found)
        design = np.hstack([np.cos(angle), np.sin(angle)])[valid]
        # the normal equations are well conditioned: peaks are at least two bins apart
        normal = design.T @ design + 1e-9 * len(design) * np.eye(design.shape[1])
        part = np.zeros_like(series)
        part[valid] = design @ np.linalg.solve(normal, design.T @ clean[valid])
        clean = clean - part
    return clean
