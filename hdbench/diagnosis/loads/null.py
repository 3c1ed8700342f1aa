"""How often noise alone shows what was seen, on this very design."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.loads.families import Cell, Family
from hdbench.diagnosis.loads.space import Space, share_p_value
from hdbench.records.trace import FloatArray

__all__ = ["FamilyLook", "look_at_families"]

# draws of the null: more where few degrees of freedom make them cheap and tails count
_LEAST_DRAWS, _MOST_DRAWS, _WORK = 2000, 10_000, 160_000
# the number of independent trials is counted where this many draws lie beyond
_BEYOND = 40
_SMALLEST = 1e-300


@dataclass(frozen=True, slots=True)
class FamilyLook:
    """What a family shows of the residual.

    Parameters
    ----------
    family : Family
        The family.
    cell : Cell
        Its best member.
    share : float
        Share of the residual's sum of squares along it.
    p_value : float
        Probability of such a member by noise, anywhere in the family.
    false_alarm : float
        Probability of such a family by noise, among all that were looked at.
    trials, all_trials : float
        Independent trials that the family, and all families together, amount to.
    """

    family: Family
    cell: Cell
    share: float
    p_value: float
    false_alarm: float
    trials: float
    all_trials: float

    def statistic(self, dof: int) -> float:
        """Return the likelihood-ratio statistic of normal noise of unknown size."""
        return -dof * float(np.log(max(1.0 - self.share, _SMALLEST)))


def _best_p(shares: FloatArray, ranks: FloatArray, dof: int) -> FloatArray:
    """Return the smallest p-value over cells, shape (n_draws,), of shares (n_cells, n_draws)."""
    from scipy.special import betainc

    best = np.ones(shares.shape[1])
    for rank in np.unique(ranks):
        # at equal rank the largest share has the smallest p-value
        top = shares[ranks == rank].max(axis=0)
        best = np.minimum(best, betainc((dof - rank) / 2.0, rank / 2.0, np.clip(1.0 - top, 0, 1)))
    return np.asarray(best)


def _trials(p_values: FloatArray) -> float:
    """Return how many independent trials a smallest p-value of these draws amounts to."""
    beyond = _BEYOND / len(p_values)
    level = float(np.quantile(p_values, beyond))
    return max(1.0, -float(np.log1p(-beyond)) / max(level, _SMALLEST))


def look_at_families(
    space: Space, families: Sequence[Family], rng: np.random.Generator
) -> tuple[FamilyLook, ...]:
    """Return what each family shows, and how often noise shows as much.

    Parameters
    ----------
    space : Space
        Residual, more than one degree of freedom.
    families : sequence of Family
        Families.
    rng : Generator
        For the draws.

    Returns
    -------
    tuple of FamilyLook
        In the order of `families`.

    Notes
    -----
    The share of the residual along a cell has the law Beta(k/2, (dof - k)/2) under normal noise of
    any size, so that draws of unit noise in the residual's own coordinates are the exact null: no
    parameter of the noise enters. The smallest p-value over a family's cells, and then over
    families, is a minimum of M trials, ``1 - (1 - p)^M``, M from the level beyond which 40 of 2000
    to 10 000 draws lie.
    """
    if not families:
        return ()
    draws = int(np.clip(_WORK // space.dof, _LEAST_DRAWS, _MOST_DRAWS))
    noise = rng.standard_normal((space.dof, draws))
    noise /= np.sqrt(np.einsum("nd,nd->d", noise, noise))
    per_family, counts, looks = [], [], []
    for family in families:
        stacked = np.hstack([cell.directions for cell in family.cells])
        ranks = np.array([cell.directions.shape[1] for cell in family.cells])
        edges = np.concatenate(([0], np.cumsum(ranks)[:-1]))
        shares = np.add.reduceat((stacked.T @ noise) ** 2, edges, axis=0)
        drawn = _best_p(shares, ranks.astype(np.float64), space.dof)
        counts.append(_trials(drawn))
        per_family.append(_at_least_one(drawn, counts[-1]))
        measured = [space.share(cell.directions) for cell in family.cells]
        p_values = [
            share_p_value(share, int(rank), space.dof)
            for share, rank in zip(measured, ranks, strict=True)
        ]
        best = min(range(len(p_values)), key=lambda i: (p_values[i], -measured[i]))
        looks.append((family, family.cells[best], measured[best], p_values[best]))
    total = _trials(np.min(per_family, axis=0))
    done = []
    for (family, cell, share, p_value), count in zip(looks, counts, strict=True):
        mine = float(_at_least_one(np.array(p_value), count))
        chance = float(_at_least_one(np.array(mine), total))
        done.append(FamilyLook(family, cell, share, mine, chance, count, total))
    return tuple(done)


def _at_least_one(p_value: FloatArray, trials: float) -> FloatArray:
    """Return ``1 - (1 - p)^trials`` without loss for small p."""
    return np.asarray(-np.expm1(trials * np.log1p(-np.minimum(p_value, 1.0 - 1e-16))))
