"""Samples of a slow trace that no load can have made: single spikes and stuck readings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

__all__ = ["find_glitches", "find_stuck", "noise_std"]

# samples looked at around each: a glitch of up to three of them leaves their median alone
_WINDOW = 9
# samples at either end of the sorted window that do not count for what is usual there
_TRIM = 3
# distance in noise standard deviations that chance does not reach in a day of samples, and in
# spans of the neighbours: a moving or swinging weight stays within a few of these
_NOISES, _SPANS = 12.0, 6.0
# equal readings in a row of a converter with noise: by chance once in 1e9 where half repeat
_STUCK = 30


def noise_std(x: FloatArray) -> float:
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
    found[there] = (off > _NOISES * noise_std(y)) & (off > _SPANS * span) & (off > 0.0)
    return found


def find_stuck(x: FloatArray) -> NDArray[np.bool_]:
    """Return which samples belong to a converter that stood still."""
    found = np.zeros(len(x), dtype=bool)
    same = np.diff(x) == 0.0
    if not len(same) or float(same.mean()) > 0.5:
        return found
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        if end - start >= _STUCK:
            found[start + 1 : end + 1] = True
    return found
