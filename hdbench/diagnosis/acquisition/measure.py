"""What a fault of the acquisition costs the baseline: residual on held-out blocks, and gain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.confirm.gain import Gain
from hdbench.diagnosis.measured.record import Record
from hdbench.records.trace import FloatArray

__all__ = ["Residual", "baseline_residual", "gain_of", "likelier_nats", "share_of"]

_FOLDS = 5
_BLOCKS = 20
_DRAWS = 2000
# blocks of the bootstrap: enough for a 95 % interval, each far longer than the noise's memory
_BOOTSTRAP_BLOCKS = 100


@dataclass(frozen=True, slots=True)
class Residual:
    """Residual of the baseline on blocks that its fit has not seen.

    Parameters
    ----------
    left_nm : ndarray, shape (n,)
        Measured less predicted, N m; zero where not valid.
    valid : ndarray of bool, shape (n,)
        Samples that count.
    """

    left_nm: FloatArray
    valid: NDArray[np.bool_]

    @property
    def mean_square(self) -> float:
        """Mean square, (N m)^2; zero without a sample."""
        return float(np.mean(self.left_nm[self.valid] ** 2)) if self.valid.any() else 0.0

    def without(self, masked: NDArray[np.bool_]) -> Residual:
        """Return the residual without the marked samples."""
        return Residual(self.left_nm, self.valid & ~masked)


def baseline_residual(record: Record, masked: NDArray[np.bool_] | None = None) -> Residual:
    """Predict every sample by the baseline fitted to the other blocks.

    Parameters
    ----------
    record : Record
        Record.
    masked : ndarray of bool, shape (n,), or None
        Samples that are predicted but do not train.

    Returns
    -------
    Residual

    Notes
    -----
    Ordinary least squares on sixteen of twenty contiguous blocks predicts the other four, five
    times.
    """
    design, response = record.base, record.response_nm
    trains = record.valid if masked is None else record.valid & ~masked
    left = np.zeros(len(response))
    blocks = np.array_split(np.flatnonzero(record.valid), _BLOCKS)
    grams = [_products(design, response, block[trains[block]]) for block in blocks]
    total = sum(g for g, _ in grams)
    right = sum(v for _, v in grams)
    for fold in range(_FOLDS):
        mine = range(fold, _BLOCKS, _FOLDS)
        gram = total - sum(grams[b][0] for b in mine)
        vector = right - sum(grams[b][1] for b in mine)
        solution = np.linalg.lstsq(gram, vector, rcond=None)[0]
        for b in mine:
            left[blocks[b]] = response[blocks[b]] - design[blocks[b]] @ solution
    return Residual(left, record.valid)


def _products(
    design: FloatArray, response: FloatArray, rows: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    part = design[rows]
    return part.T @ part, part.T @ response[rows]


def _sums(residual: Residual, edges: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
    squares = np.where(residual.valid, residual.left_nm**2, 0.0)
    counts = residual.valid.astype(float)
    return np.add.reduceat(squares, edges), np.add.reduceat(counts, edges)


def gain_of(before: Residual, after: Residual, rng: np.random.Generator) -> Gain:
    """Return the gain from one residual to another on the same time axis.

    Parameters
    ----------
    before, after : Residual
        Residuals with the fault in, and with it masked or modelled.
    rng : Generator
        For the paired block bootstrap.

    Returns
    -------
    Gain
        ``explained_fraction`` is one less the ratio of the mean squares, each over its own samples.
    """
    count = len(before.left_nm)
    edges = np.unique(np.linspace(0, count, _BOOTSTRAP_BLOCKS, endpoint=False).astype(np.intp))
    old, n_old = _sums(before, edges)
    new, n_new = _sums(after, edges)
    pick = rng.integers(0, len(edges), (_DRAWS, len(edges)))
    weight_old = old[pick].sum(axis=1) * n_new[pick].sum(axis=1)
    weight_new = new[pick].sum(axis=1) * n_old[pick].sum(axis=1)
    good = weight_old > 0.0
    fractions = 1.0 - weight_new[good] / weight_old[good]
    low, high = np.percentile(fractions, (2.5, 97.5)) if good.any() else (0.0, 0.0)
    ms_old, ms_new = before.mean_square, after.mean_square
    fraction = 1.0 - ms_new / ms_old if ms_old > 0.0 else 0.0
    return Gain(float(np.sqrt(ms_old)), float(np.sqrt(ms_new)), fraction, (float(low), float(high)))


def share_of(before: Residual, after: Residual) -> float:
    """Return the part of the residual's variance that goes with the fault, in [0, 1].

    Parameters
    ----------
    before, after : Residual
        Residuals with the fault in, and with it masked or modelled.

    Returns
    -------
    float
    """
    old = before.mean_square
    return float(np.clip(1.0 - after.mean_square / old, 0.0, 1.0)) if old > 0.0 else 0.0


def likelier_nats(one: Residual, other: Residual) -> float:
    """Return by how much one baseline is likelier than another, nats; negative where it is less so.

    Parameters
    ----------
    one, other : Residual
        Residuals on the same samples.

    Returns
    -------
    float
        ``n_eff / 2 ln(mean square of other / mean square of one)``; n_eff is the number of samples
        less what neighbours share, ``n (1 - r) / (1 + r)`` with r the correlation of neighbours in
        the smaller residual.
    """
    left = min(one, other, key=lambda residual: residual.mean_square)
    values = left.left_nm[left.valid]
    power = float(values @ values)
    if not power > 0.0:
        return 0.0
    shared = float(np.clip(values[1:] @ values[:-1] / power, 0.0, 0.999))
    freedom = len(values) * (1.0 - shared) / (1.0 + shared)
    return 0.5 * freedom * float(np.log(other.mean_square / max(one.mean_square, 1e-300)))
