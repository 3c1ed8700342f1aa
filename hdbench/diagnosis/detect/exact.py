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
    left = space.project(columns)
    white_size = np.einsum("nk,nk->k", left, left)
    before = white_size + np.sum((space.pull_basis.T @ columns) ** 2, axis=0)
    # an effect of 1000 N m, the most that the catalogue allows, would stay below the noise
    if not np.all(before > _FAINTEST):
        return 0.0, 0, np.zeros(columns.shape[1]), left
    scale = 1.0 / np.sqrt(before)
    gram = (left.T @ left) * np.outer(scale, scale)
    values, vectors = np.linalg.eigh(gram)
    good = values > MIN_SHARE
    right = vectors[:, good].T @ (scale * (left.T @ space.residual))
    linear = scale * (vectors[:, good] @ (right / values[good]))
    return float(np.sum(right**2 / values[good])), int(good.sum()), linear, left
