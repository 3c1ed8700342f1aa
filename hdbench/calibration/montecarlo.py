"""The gain by Monte Carlo beside the formula: every source drawn from its distribution."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hdbench.records.trace import FloatArray
from hdbench.results.calibration import BudgetRow, MonteCarlo

__all__ = ["DRAWS", "propagate"]

# number of trials that fixes the ends of a 95 % interval to two digits of the uncertainty
DRAWS = 1_000_000
# standard uncertainties of an end within which chance differs in 1 of 400 cases
_SIGMAS = 3.0
# the density about an end is that of this share of the trials to either side
_SPAN = 500
# trials in hand at a time: 2 MB per array
_BLOCK = 250_000


def propagate(
    value: float,
    rows: Sequence[BudgetRow],
    formula: tuple[float, float],
    *,
    seed: int = 0,
    draws: int = DRAWS,
) -> MonteCarlo | None:
    """Draw the gain.

    Notes
    -----
    ``G = value (1 + sum of draws)``; a source with degrees of freedom is a scaled t. Intervals
    are compared, not standard deviations: a t of 3 dof has sqrt(3) times its scale.

    References
    ----------
    .. [1] JCGM 101:2008, sections 6.4.9.5, 7.7 and 8.1.
    """
    sized = [row for row in rows if row.relative_std > 0.0]
    if not sized or value == 0.0:
        return None
    generator = np.random.default_rng(seed)
    parts = [min(_BLOCK, draws - done) for done in range(0, draws, _BLOCK)]
    trials = np.sort(value * np.concatenate([1.0 + _block(generator, sized, n) for n in parts]))
    keep = round(0.95 * draws)
    low = (draws - keep) // 2
    equal = (float(trials[low]), float(trials[low + keep - 1]))
    narrow = int(np.argmin(trials[keep - 1 :] - trials[: draws - keep + 1]))
    std, expanded = formula
    digit = 0.5 * 10.0 ** (math.floor(math.log10(std)) - 1)
    tolerance = max(digit, _SIGMAS * max(_end_std(trials, end) for end in (low, low + keep - 1)))
    ends = (value - expanded, value + expanded)
    return MonteCarlo(
        draws=draws,
        seed=seed,
        mean_nm_per_v=float(trials.mean()),
        std_nm_per_v=float(trials.std(ddof=1)),
        interval_nm_per_v=equal,
        shortest_interval_nm_per_v=(float(trials[narrow]), float(trials[narrow + keep - 1])),
        expanded_nm_per_v=(equal[1] - equal[0]) / 2.0,
        agrees_with_formula=all(abs(a - b) <= tolerance for a, b in zip(ends, equal, strict=True)),
        tolerance_nm_per_v=tolerance,
    )


def _end_std(trials: FloatArray, place: int) -> float:
    """Return the standard uncertainty of an order statistic, by the density about it."""
    n = len(trials)
    p, reach = (place + 0.5) / n, max(1, n // _SPAN)
    low, high = max(0, place - reach), min(n - 1, place + reach)
    slope = float(trials[high] - trials[low]) * n / (high - low)
    return math.sqrt(p * (1.0 - p) / n) * slope


def _block(generator: np.random.Generator, rows: Sequence[BudgetRow], n: int) -> FloatArray:
    """Return the relative deviation of n trials."""
    total = np.zeros(n)
    for row in rows:
        if row.dof is not None:
            total += row.relative_std * generator.standard_t(row.dof, n)
        elif row.distribution == "rectangular":
            half = row.relative_std * math.sqrt(3.0)
            total += generator.uniform(-half, half, n)
        else:
            total += row.relative_std * generator.standard_normal(n)
    return total
