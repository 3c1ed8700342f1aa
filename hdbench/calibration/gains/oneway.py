"""Repeatability and spread between positions by analysis of variance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["OneWay", "one_way"]


@dataclass(frozen=True, slots=True)
class OneWay:
    """One-way analysis of variance of gains with the position as random effect.

    Parameters
    ----------
    n_positions, n : int
        Positions and experiments.
    replicates : float
        Experiments per position; the effective number where positions have different ones.
    between, within : float
        Mean squares, (N m/V)^2.
    ratio, probability : float or None
        F and the chance of one as large without a spread between positions; None without
        scatter within positions.
    repeatability, between_std, reproducibility : float
        Standard deviations within a position, between positions, of any one experiment, N m/V.
    intraclass : float or None
        Share of the variance between positions; None where there is no variance.
    mean_std : float
        Standard uncertainty of the mean over positions, N m/V, with n_positions - 1 dof.
    """

    n_positions: int
    n: int
    replicates: float
    between: float
    within: float
    ratio: float | None
    probability: float | None
    repeatability: float
    between_std: float
    reproducibility: float
    intraclass: float | None
    mean_std: float

    @property
    def any_one(self) -> tuple[float, float]:
        """Standard uncertainty of the gain at one unknown position, and its dof.

        ``u^2 = u(mean)^2 + s_R^2``, both made of the two independent mean squares, to which
        Satterthwaite's formula is applied: ``u^2 = (1 + 1/p) MSB / q + (1 - 1/q) MSW``.
        """
        p, q = self.n_positions, self.replicates
        first = max(self.between, self.within) * (1.0 + 1.0 / p) / q
        second = self.within * (1.0 - 1.0 / q)
        loss = first**2 / (p - 1)
        if self.n > p:
            loss += second**2 / (self.n - p)
        variance = first + second
        return math.sqrt(variance), variance**2 / loss if loss > 0.0 else float(p - 1)

    def to_dict(self) -> dict[str, object]:
        """Return the analysis as results store it."""
        return {
            "n_positions": self.n_positions,
            "n_experiments": self.n,
            "replicates": self.replicates,
            "mean_square_between": self.between,
            "mean_square_within": self.within,
            "f_ratio": self.ratio,
            "probability": self.probability,
            "repeatability_nm_per_v": self.repeatability,
            "between_positions_nm_per_v": self.between_std,
            "reproducibility_nm_per_v": self.reproducibility,
            "intraclass_correlation": self.intraclass,
            "mean_std_nm_per_v": self.mean_std,
            "mean_dof": self.n_positions - 1,
        }


def one_way(groups: Sequence[Sequence[float]]) -> OneWay | None:
    """Split the scatter of gains into within and between positions.

    Parameters
    ----------
    groups : sequence of sequence of float
        Gains of each position, N m/V.

    Returns
    -------
    OneWay or None
        None for fewer than two positions, or no position with two experiments.

    Notes
    -----
    ``MSB = sum n_i (G_i - G)^2 / (p - 1)``, ``MSW = sum (G_ij - G_i)^2 / (N - p)``,
    ``s_pos^2 = max(0, (MSB - MSW) / q)`` with ``q = (N - sum n_i^2 / N) / (p - 1)``.

    References
    ----------
    .. [1] S. R. Searle, G. Casella, C. E. McCulloch, Variance Components, Wiley 1992, section 3.6.
    """
    p, n = len(groups), sum(len(g) for g in groups)
    if p < 2 or n <= p:
        return None
    arrays = [np.asarray(g, dtype=float) for g in groups]
    total = float(np.concatenate(arrays).mean())
    between = math.fsum(len(a) * (float(a.mean()) - total) ** 2 for a in arrays) / (p - 1)
    within = math.fsum(float(((a - a.mean()) ** 2).sum()) for a in arrays) / (n - p)
    q = (n - sum(len(a) ** 2 for a in arrays) / n) / (p - 1)
    place = max(0.0, (between - within) / q)
    ratio = between / within if within > 0.0 else None
    variance = place + within
    return OneWay(
        n_positions=p,
        n=n,
        replicates=q,
        between=between,
        within=within,
        ratio=ratio,
        probability=None if ratio is None else _tail(p - 1, n - p, ratio),
        repeatability=math.sqrt(within),
        between_std=math.sqrt(place),
        reproducibility=math.sqrt(variance),
        intraclass=place / variance if variance > 0.0 else None,
        mean_std=math.sqrt(between / n),
    )


def _tail(first: int, second: int, ratio: float) -> float:
    from scipy.special import fdtrc

    return float(fdtrc(first, second, ratio))
