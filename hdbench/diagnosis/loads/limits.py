"""The smallest effect that these readings would have shown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdbench.diagnosis.loads.families import Cell
from hdbench.diagnosis.loads.fit import LoadFit
from hdbench.diagnosis.loads.null import FamilyLook
from hdbench.diagnosis.loads.shapes import columns_of
from hdbench.diagnosis.loads.space import Space

__all__ = ["least_sigmas", "minimum_detectable_load"]

# standard normal quantile of 90 %
_POWER = 1.2815515655446004


def minimum_detectable_load(
    fit: LoadFit, space: Space, looks: Sequence[FamilyLook], alpha: float
) -> tuple[tuple[str, float], ...]:
    """Return the size of each kind of effect that would have been found with 90 %.

    Parameters
    ----------
    fit : LoadFit
        Final fit.
    space : Space
        What it leaves.
    looks : sequence of FamilyLook
        Looks at it.
    alpha : float
        False-alarm rate.

    Returns
    -------
    tuple of (str, float)
        Name, and the largest torque of the effect on these readings, N m: the median over the
        shapes that were looked at, of the form that shows best.

    Notes
    -----
    A family passes at the p-value that its trials and those of all families leave of `alpha`. The
    share of the residual that this asks for is carried to standard deviations by the F law;
    an effect of d of them passes with 90 % from ``d = sqrt(k F) + 1.28``.
    """
    noise = float(np.sqrt(fit.rss / max(fit.dof, 1))) / abs(fit.slope_v_per_nm)
    limits: dict[str, float] = {}
    for look in looks:
        if look.family.name == "outlier":
            continue
        sizes = []
        for cell in look.family.cells:
            needed = _needed_sigmas(look, cell.directions.shape[1], space, alpha)
            sizes.append(needed * noise * _size_per_sigma(cell, fit, space))
        size = float(np.median(sizes))
        limits[look.family.name] = min(size, limits.get(look.family.name, size))
    return tuple(limits.items())


def least_sigmas(space: Space, looks: Sequence[FamilyLook], alpha: float) -> float:
    """Return how many standard deviations of its own any effect needs here to be found with 90 %.

    Parameters
    ----------
    space : Space
        What the final fit leaves.
    looks : sequence of FamilyLook
        Looks at it.
    alpha : float
        False-alarm rate.

    Returns
    -------
    float
        Of the family that needs fewest; infinite where nothing could be looked for.
    """
    needed = [
        _needed_sigmas(look, look.cell.directions.shape[1], space, alpha)
        for look in looks
        if look.family.name != "outlier"
    ]
    return min(needed, default=float("inf"))


def _needed_sigmas(look: FamilyLook, rank: int, space: Space, alpha: float) -> float:
    from scipy.special import betaincinv

    level = alpha / (look.trials * look.all_trials)
    rest = float(betaincinv((space.dof - rank) / 2.0, rank / 2.0, level))
    return float(np.sqrt((1.0 - rest) / max(rest, 1e-300) * (space.dof - rank))) + _POWER


def _size_per_sigma(cell: Cell, fit: LoadFit, space: Space) -> float:
    """Return the largest torque of an effect that leaves a residual of length 1."""
    columns = columns_of(cell.term, fit.table)[fit.table.used]
    left = space.basis.T @ columns
    length = np.sqrt(np.einsum("nk,nk->k", left, left))
    seen = length > 0.0
    return float(np.mean(np.abs(columns[:, seen]).max(axis=0) / length[seen]))
