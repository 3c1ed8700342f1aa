"""When a static reading has settled."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.records import FloatArray

__all__ = ["SettledReading", "settled_reading"]


@dataclass(frozen=True, slots=True)
class SettledReading:
    """The average of a settled window.

    Parameters
    ----------
    mean_v, std_v : float
        Mean and standard deviation of the samples averaged, V.
    n_samples : int
        Samples averaged.
    settled : bool
        False where the time was up before the reading had settled.
    """

    mean_v: float
    std_v: float
    n_samples: int
    settled: bool


def settled_reading(samples_v: FloatArray, window: int, band_v: float) -> SettledReading | None:
    """Average the last window once it agrees with the window before it.

    Parameters
    ----------
    samples_v : ndarray, shape (n_samples,)
        Readings since the weight was hung, V.
    window : int
        Samples per window, at least 2.
    band_v : float
        Largest drift between two windows, V, beside what noise alone explains.

    Returns
    -------
    SettledReading or None
        None while the reading has not settled.

    Notes
    -----
    Settled when the two window means differ by less than `band_v` plus three standard errors of
    that difference, and the spread of the last window is no more than 1.5 times what its
    sample-to-sample differences explain (a swinging weight is correlated, noise is not):
    std <= 1.5 * std(diff)/sqrt(2), or below `band_v`.
    """
    if len(samples_v) < 2 * window:
        return None
    before, last = samples_v[-2 * window : -window], samples_v[-window:]
    std = float(np.std(last, ddof=1))
    quick = float(np.std(np.diff(last), ddof=1)) / math.sqrt(2.0)
    error = math.sqrt((float(np.var(before, ddof=1)) + std**2) / window)
    still = abs(float(np.mean(last) - np.mean(before))) <= band_v + 3.0 * error
    calm = std <= max(1.5 * quick, band_v)
    if not (still and calm):
        return None
    return SettledReading(float(np.mean(last)), std, window, settled=True)
