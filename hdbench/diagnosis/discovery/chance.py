"""Tails of the chi-squared law, without the cost of importing all of `scipy.stats`."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, chdtri

from hdbench.records.trace import FloatArray


def chi2_tail(value: float, dof: float) -> float:
    """Return the probability of a chi^2 of `dof` above `value`."""
    return float(chdtrc(dof, max(value, 0.0)))


def chi2_tails(values: FloatArray, dof: float) -> FloatArray:
    """Return the probability of a chi^2 of `dof` above each value."""
    return np.asarray(chdtrc(dof, np.maximum(values, 0.0)))


def chi2_level(chance: float, dof: float) -> float:
    """Return the value that a chi^2 of `dof` exceeds with this probability."""
    return float(chdtri(dof, chance))
