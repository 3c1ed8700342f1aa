"""The line through the first and the last point, with the uncertainty of both."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.records.trace import FloatArray

__all__ = ["TerminalLine", "terminal_line"]


@dataclass(frozen=True, slots=True)
class TerminalLine:
    """``y = intercept + slope x`` through two points.

    Parameters
    ----------
    slope, slope_std : float
        Slope and its standard uncertainty.
    intercept, intercept_std : float
        Intercept and its standard uncertainty.
    correlation : float
        Correlation of the two; 0 where one is known.
    deviation : ndarray, shape (n,)
        Every y less the line.
    """

    slope: float
    slope_std: float
    intercept: float
    intercept_std: float
    correlation: float
    deviation: FloatArray


def terminal_line(
    x: FloatArray, y: FloatArray, *, std_x: float = 0.0, relative_std_y: float = 0.0
) -> TerminalLine:
    """Draw the line through the first and the last point.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
        Readings and reference values, at least two with different readings at the ends.
    std_x : float
        Standard uncertainty of a reading.
    relative_std_y : float
        Relative standard uncertainty of a reference value, independent at the ends.

    Returns
    -------
    TerminalLine

    Raises
    ------
    ValueError
        If the two readings are the same.

    References
    ----------
    .. [1] R. Kessel, R. N. Kacker, K.-D. Sommer, Measurement 45 (2012) 1661, section 4.
    """
    first, last = float(x[0]), float(x[-1])
    span = last - first
    if not span != 0.0:
        raise ValueError(f"the readings at both ends are {first!r}; needed: two that differ")
    slope = (float(y[-1]) - float(y[0])) / span
    intercept = float(y[-1]) - slope * last
    # derivatives by reading and reference of the first point, then of the last
    by_slope = np.array([slope, -1.0, -slope, 1.0]) / span
    by_intercept = np.array([-slope * last, last, slope * first, -first]) / span
    stds = np.array(
        [std_x, relative_std_y * abs(float(y[0])), std_x, relative_std_y * abs(float(y[-1]))]
    )
    variance = (by_slope**2 @ stds**2, by_intercept**2 @ stds**2)
    both = float(by_slope * by_intercept @ stds**2)
    product = math.sqrt(float(variance[0]) * float(variance[1]))
    return TerminalLine(
        slope,
        math.sqrt(float(variance[0])),
        intercept,
        math.sqrt(float(variance[1])),
        both / product if product > 0.0 else 0.0,
        np.asarray(y - intercept - slope * x),
    )
