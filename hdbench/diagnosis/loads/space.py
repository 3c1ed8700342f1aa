"""What is left of the readings after a fit, in coordinates in which noise is white."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.records.trace import FloatArray

__all__ = ["Space", "make_space", "share_p_value"]

# directions whose share of the scaled columns falls below this cannot be resolved
_RANK = 1e-9
# what is left of a column below this share of its size is what the fit has already
_VISIBLE = 1e-5


@dataclass(frozen=True, slots=True)
class Space:
    """Orthonormal complement of a fit.

    Parameters
    ----------
    used : ndarray of bool, shape (n,)
        Readings of the fit.
    basis : ndarray, shape (n_used, dof)
        Orthonormal columns, orthogonal to all that the fit explains.
    residual_v : ndarray, shape (dof,)
        Residual in that basis, V.
    """

    used: NDArray[np.bool_]
    basis: FloatArray
    residual_v: FloatArray

    @property
    def dof(self) -> int:
        """Degrees of freedom of the residual."""
        return int(self.basis.shape[1])

    @property
    def rss(self) -> float:
        """Sum of squares of the residual, V^2."""
        return float(self.residual_v @ self.residual_v)

    def directions(self, columns: FloatArray) -> FloatArray:
        """Return an orthonormal basis of what the fit leaves of some columns.

        Parameters
        ----------
        columns : ndarray, shape (n, k)
            Columns, any unit.

        Returns
        -------
        ndarray, shape (dof, rank)
            Rank 0 where the fit explains all of them.
        """
        raw = columns[self.used]
        if not np.isfinite(raw).all():
            return np.zeros((self.dof, 0))
        size = np.sqrt(np.einsum("nk,nk->k", raw, raw))
        seen = size > 0.0
        left = self.basis.T @ (raw[:, seen] / size[seen])
        if left.shape[1] == 1:
            length = float(np.linalg.norm(left))
            return np.asarray(left / length if length > _VISIBLE else left[:, :0])
        u, s, _ = np.linalg.svd(left, full_matrices=False)
        return np.asarray(u[:, s > _VISIBLE])

    @staticmethod
    def sine_squared(first: FloatArray, second: FloatArray) -> float:
        """Return the sine squared of the largest angle between two spaces of one dimension.

        Parameters
        ----------
        first, second : ndarray, shape (dof, rank)
            Orthonormal bases, rank at least 1.

        Returns
        -------
        float
        """
        between = first.T @ second
        least = (
            float(np.linalg.svd(between, compute_uv=False).min())
            if between.size > 1
            else (float(np.abs(between).min()))
        )
        return 1.0 - least**2

    def share(self, directions: FloatArray) -> float:
        """Return which share of the residual's sum of squares lies along directions."""
        along = directions.T @ self.residual_v
        return float(along @ along) / self.rss if self.rss > 0.0 else 0.0


def make_space(explained: FloatArray, response_v: FloatArray, used: NDArray[np.bool_]) -> Space:
    """Return the complement of what a fit explains.

    Parameters
    ----------
    explained : ndarray, shape (n, p)
        Columns that span the fit.
    response_v : ndarray, shape (n,)
        Readings, V.
    used : ndarray of bool, shape (n,)
        Readings of the fit.

    Returns
    -------
    Space
    """
    columns = explained[used]
    size = np.sqrt(np.einsum("nk,nk->k", columns, columns))
    u, s, _ = np.linalg.svd(columns / np.where(size > 0.0, size, 1.0), full_matrices=True)
    rank = int((s > _RANK * s[0]).sum()) if len(s) else 0
    basis = np.asarray(u[:, rank:])
    return Space(used, basis, basis.T @ response_v[used])


def share_p_value(share: float, rank: int, dof: int) -> float:
    """Return the probability that noise puts at least this share along given directions.

    Parameters
    ----------
    share : float
        Share of the sum of squares, in [0, 1].
    rank : int
        Number of directions.
    dof : int
        Degrees of freedom of the residual, more than `rank`.

    Returns
    -------
    float
        Of normal noise of unknown size the share has the law Beta(rank / 2, (dof - rank) / 2): the
        F test.
    """
    from scipy.special import betainc

    if not dof > rank > 0:
        return 1.0
    rest = min(max(1.0 - share, 0.0), 1.0)
    return float(betainc((dof - rank) / 2.0, rank / 2.0, rest))
