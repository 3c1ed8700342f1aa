"""Whitening of records with gaps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.estimation.noise import NoiseModel, run_positions
from hdbench.records.trace import FloatArray

__all__ = ["whiten"]


def whiten(
    columns: FloatArray,
    model: NoiseModel,
    valid: NDArray[np.bool_] | None = None,
    *,
    starts: NDArray[np.bool_] | None = None,
) -> FloatArray:
    """Divide out the colour of the noise: the result has unit, white noise.

    Parameters
    ----------
    columns : ndarray, shape (n,) or (n, k)
        Response or design columns, unit of the noise.
    model : NoiseModel
        Noise to be whitened.
    valid : ndarray of bool, shape (n,), optional
        Samples that can be used; all without it. A gap splits the record.
    starts : ndarray of bool, shape (n,), optional
        Where a new stretch begins, see `run_positions`.

    Returns
    -------
    ndarray, shape (n,) or (n, k)
        Whitened columns, dimensionless; 0 where not valid.

    Notes
    -----
    ``x~(k) = (x(k) - sum_i a_i x(k - i)) / std``; the first samples of each run use the
    predictors of lower order, so that no sample is lost and the likelihood is exact for a
    stationary Gaussian noise. Cost O(n k order).
    """
    table = columns[:, None] if columns.ndim == 1 else columns
    usable = np.ones(len(table), dtype=bool) if valid is None else valid
    position = run_positions(usable, starts)
    filled = np.where(usable[:, None], table, 0.0)
    kernel = np.concatenate([[1.0], -model.coefficients])
    white = np.empty_like(filled)
    for column in range(filled.shape[1]):
        white[:, column] = np.convolve(filled[:, column], kernel)[: len(filled)]
    white /= model.innovation_std
    for order in range(model.order):
        at = np.flatnonzero(position == order)
        past = filled[at[:, None] - np.arange(1, order + 1)]
        guess = np.einsum("rjk,j->rk", past, model.predictors[order])
        white[at] = (filled[at] - guess) / model.stds[order]
    white[~usable] = 0.0
    return white[:, 0] if columns.ndim == 1 else white
