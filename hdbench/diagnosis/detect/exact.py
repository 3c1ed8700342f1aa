"""Exact statistics of columns beside what is explained."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.noise.whitened import Space
from hdbench.records.trace import FloatArray

__all__ = ["MIN_SHARE", "exact_statistic", "solve_exactly"]

# share of a column that must be left after the explained part was projected out
MIN_SHARE = 0.01
# whitened size squared of a column of which 1000 N m are one standard deviation
_FAINTEST = 1e-6


def exact_statistic(space: Space, columns: FloatArray) -> tuple[float, int, FloatArray]:
    """Return the statistic of columns in a space, its dof and the linear parameters.

    Parameters
    ----------
    space : Space
        Whitened residual.
    columns : ndarray, shape (n, k)
        Columns, N m per unit.

    Returns
    -------
    statistic : float
        ``v' (X' M X)^+ v``.
    dof : int
        Rank of what is left of the columns.
    linear : ndarray, shape (k,)
        Linear parameters.
    """
    return solve_exactly(space, columns)[:3]


def solve_exactly(space: Space, columns: FloatArray) -> tuple[float, int, FloatArray, FloatArray]:
    """Return statistic, dof, linear parameters and what is left of the whitened columns.

    Parameters
    ----------
    space : Space
        Whitened residual.
    columns : ndarray, shape (n, k)
        Columns, N m per unit.

    Returns
    -------
    statistic : float
    dof : int
    linear : ndarray, shape (k,)
    left : ndarray, shape (n, k)
        As `exact_statistic` gives them, and ``M A columns``.
    """
    white = space.whitener.apply(columns)
    before = np.einsum("nk,nk->k", white, white)
    white -= space.basis @ (space.basis.T @ white)
    return (*_solved(before, white.T @ white, white.T @ space.residual), white)


def _solved(
    before: FloatArray, left: FloatArray, right: FloatArray
) -> tuple[float, int, FloatArray]:
    """Return statistic, dof and linear parameters.

    From the whitened columns' squares, and from what is left of them times itself and times the
    residual.
    """
    # an effect of 1000 N m, the most that the catalogue allows, would stay below the noise
    if not np.all(before > _FAINTEST):
        return 0.0, 0, np.zeros(len(before))
    scale = 1.0 / np.sqrt(before)
    values, vectors = np.linalg.eigh(left * np.outer(scale, scale))
    good = values > MIN_SHARE
    right = vectors[:, good].T @ (scale * right)
    linear = scale * (vectors[:, good] @ (right / values[good]))
    return float(np.sum(right**2 / values[good])), int(good.sum()), linear
