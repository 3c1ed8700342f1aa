"""Clockwise against anticlockwise, low range against full range, fits against their scatter."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.records.quantity import Quantity

__all__ = ["Consensus", "PairedDifference", "consensus", "paired_difference"]

# means of both levels that cancel to this share of either have no relative difference
_CANCELLED = 1e-9
# steps that bring the variance of Paule and Mandel to rounding: it converges quadratically
_STEPS = 60


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """Mean difference of pairs that share all but one thing.

    Parameters
    ----------
    first, second : str
        What is compared.
    mean_first, mean_second : float
        Means over the pairs, N m/V.
    difference : Quantity
        First less second, N m/V.
    statistic, probability : float or None
        Student's t; the chance of one as large without a difference. None without scatter.
    n_pairs : int
        Pairs.
    """

    first: str
    second: str
    mean_first: float
    mean_second: float
    difference: Quantity
    statistic: float | None
    probability: float | None
    n_pairs: int

    @property
    def relative(self) -> float:
        """Difference over the mean of the two."""
        return 2.0 * self.difference.value / (self.mean_first + self.mean_second)

    def to_dict(self) -> dict[str, object]:
        """Return the comparison as results store it."""
        mean = abs(self.mean_first + self.mean_second) / 2.0
        difference = self.difference
        return {
            "first": self.first,
            "second": self.second,
            "mean_first_nm_per_v": self.mean_first,
            "mean_second_nm_per_v": self.mean_second,
            "difference_nm_per_v": difference.to_dict(),
            "relative": {
                "value": self.relative,
                "std": difference.std / mean,
                "dof": difference.dof,
            },
            "t_statistic": self.statistic,
            "probability": self.probability,
            "n_pairs": self.n_pairs,
        }


def paired_difference(
    entries: Sequence[tuple[Hashable, str, float]], first: str, second: str
) -> PairedDifference | None:
    """Compare two levels over the pairs that have both.

    Parameters
    ----------
    entries : sequence of (hashable, str, float)
        What the members of a pair share, level, gain in N m/V.
    first, second : str
        The two levels.

    Returns
    -------
    PairedDifference or None
        None for fewer than two pairs, or for means that cancel.

    Notes
    -----
    Gains of one level of one pair are averaged. ``t = mean / (s / sqrt(n))`` with n - 1 dof: what
    a pair shares, the position above all, is not in s.
    """
    pairs: dict[Hashable, dict[str, list[float]]] = {}
    for shared, level, gain in entries:
        pairs.setdefault(shared, {}).setdefault(level, []).append(gain)
    both = [p for p in pairs.values() if first in p and second in p]
    if len(both) < 2:
        return None
    one = np.array([math.fsum(p[first]) / len(p[first]) for p in both])
    two = np.array([math.fsum(p[second]) / len(p[second]) for p in both])
    apart = one - two
    sizes = float(np.mean(np.abs(one)) + np.mean(np.abs(two)))
    if not abs(float(one.mean() + two.mean())) > _CANCELLED * sizes:
        return None
    mean, std = float(apart.mean()), float(apart.std(ddof=1)) / math.sqrt(len(both))
    dof = float(len(both) - 1)
    statistic = mean / std if std > 0.0 else None
    return PairedDifference(
        first,
        second,
        float(one.mean()),
        float(two.mean()),
        Quantity(mean, std, dof),
        statistic,
        None if statistic is None else _two_sided(statistic, dof),
        len(both),
    )


def _two_sided(statistic: float, dof: float) -> float:
    from scipy.special import stdtr

    return 2.0 * float(stdtr(dof, -abs(statistic)))


@dataclass(frozen=True, slots=True)
class Consensus:
    """Gains weighted by their own uncertainties.

    Parameters
    ----------
    birge_ratio : float
        Scatter of the gains over what their own uncertainties explain.
    chi_square : float
        Weighted sum of squares about the weighted mean, n - 1 dof.
    between_std : float
        Standard deviation between experiments beyond their own uncertainty, N m/V.
    mean : Quantity
        Mean weighted with both, N m/V.
    """

    birge_ratio: float
    chi_square: float
    between_std: float
    mean: Quantity

    def to_dict(self) -> dict[str, object]:
        """Return the consensus as results store it."""
        return {
            "birge_ratio": self.birge_ratio,
            "chi_square": self.chi_square,
            "between_std_nm_per_v": self.between_std,
            "weighted_mean_nm_per_v": self.mean.to_dict(),
        }


def consensus(gains: Sequence[float], stds: Sequence[float]) -> Consensus | None:
    """Weigh gains by their own uncertainties and find what these do not explain.

    Parameters
    ----------
    gains, stds : sequence of float
        Gains and their standard uncertainties, N m/V.

    Returns
    -------
    Consensus or None
        None for fewer than two gains or one without uncertainty.

    Notes
    -----
    ``sum (G_i - G)^2 / (u_i^2 + tau^2) = n - 1`` is solved for tau^2 by Newton's steps; the
    Birge ratio is ``sqrt(sum (G_i - G_w)^2 / u_i^2 / (n - 1))``.

    References
    ----------
    .. [1] R. C. Paule, J. Mandel, J. Res. NBS 87 (1982) 377, doi:10.6028/jres.087.022.
    """
    y, own = np.asarray(gains, dtype=float), np.asarray(stds, dtype=float) ** 2
    n = len(y)
    if n < 2 or not (own > 0.0).all():
        return None
    chi_square = float(_weighted(y, 1.0 / own)[1])
    extra = 0.0
    for _ in range(_STEPS):
        weights = 1.0 / (own + extra)
        mean, total = _weighted(y, weights)
        over = total - (n - 1)
        if not over > 0.0:
            break
        extra += over / float((weights**2 * (y - mean) ** 2).sum())
    weights = 1.0 / (own + extra)
    mean = _weighted(y, weights)[0]
    return Consensus(
        math.sqrt(chi_square / (n - 1)),
        chi_square,
        math.sqrt(extra),
        Quantity(mean, 1.0 / math.sqrt(float(weights.sum())), float(n - 1)),
    )


def _weighted(y: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    mean = float((weights * y).sum() / weights.sum())
    return mean, float((weights * (y - mean) ** 2).sum())
