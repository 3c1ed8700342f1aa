"""Quantiles of simulated draws, with the uncertainty that their number leaves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.records.trace import FloatArray

__all__ = ["Quantile", "sample_quantile"]

# 0.975 quantile of the normal distribution
_NORMAL_95 = 1.959963984540054


@dataclass(frozen=True, slots=True)
class Quantile:
    """One quantile of a simulated quantity.

    Parameters
    ----------
    share : float
        Share of the draws at or below it, in (0, 1).
    value : float
        The quantile, unit of the quantity.
    low, high : float
        95 % interval of it from the number of draws.
    """

    share: float
    value: float
    low: float
    high: float


def sample_quantile(values: FloatArray, share: float) -> Quantile:
    """Return a quantile of draws and its 95 % interval."""
    ordered = np.sort(values)
    n = len(ordered)
    half = _NORMAL_95 * math.sqrt(n * share * (1.0 - share))
    low = min(max(math.floor(n * share - half) - 1, 0), n - 1)
    high = min(math.ceil(n * share + half), n - 1)
    value = float(np.quantile(ordered, share))
    return Quantile(share, value, float(ordered[low]), float(ordered[high]))
