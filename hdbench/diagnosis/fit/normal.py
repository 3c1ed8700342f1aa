"""Normal equations of a least-squares fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.records.trace import FloatArray

__all__ = ["Normal", "normal_solve"]

# directions whose share of the scaled normal matrix falls below this cannot be resolved
_RANK = 1e-11


def normal_solve(gram: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the minimum-norm solution of a normal equation, scaled first, and its inverse.

    Parameters
    ----------
    gram : ndarray, shape (k, k)
        Columns times themselves.
    right : ndarray, shape (k,)
        Columns times the response.

    Returns
    -------
    solution : ndarray, shape (k,)
    inverse : ndarray, shape (k, k)
    """
    size = np.sqrt(np.diag(gram))
    size = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    good = values > _RANK * values[-1]
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T
    inverse = inverse / np.outer(size, size)
    return inverse @ right, inverse


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal equations of a fit at given shapes.

    Parameters
    ----------
    gram : ndarray, shape (k, k)
        Whitened columns times themselves.
    right : ndarray, shape (k,)
        Whitened columns times the whitened response.
    total : float
        Sum of squares of the whitened response.
    slices : tuple of slice
        Columns of each term.
    """

    gram: FloatArray
    right: FloatArray
    total: float
    slices: tuple[slice, ...]

    def left_without(self, index: int) -> float:
        """Return the sum of squares that is left without one term.

        Parameters
        ----------
        index : int
            Index of the term.

        Returns
        -------
        float
        """
        gram, right = self.gram.copy(), self.right.copy()
        gone = self.slices[index]
        gram[gone] = 0.0
        gram[:, gone] = 0.0
        right[gone] = 0.0
        solution, _ = normal_solve(gram, right)
        return self.total - float(right @ solution)
