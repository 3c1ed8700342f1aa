"""What a model of readings gains on readings that its fit has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.confirm.gain import Gain
from hdbench.diagnosis.loads.fit import LoadFit
from hdbench.diagnosis.loads.shapes import columns_of
from hdbench.diagnosis.loads.table import LoadTable, one_hot
from hdbench.records.trace import FloatArray

__all__ = ["Folds", "fold_kinds", "gain_between_readings", "held_out_nm"]

_DRAWS = 2000
# fewer units than this cannot carry a bootstrap: readings are drawn instead
_LEAST_UNITS = 5
# torques of one load level differ by less than this share of the largest torque
_LEVEL_SHARE = 1e-3
# a reading that is alone in fixing a coefficient says nothing about the prediction
_ALONE = 1e-9
_RANK = 1e-9

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Folds:
    """A way to leave readings out.

    Parameters
    ----------
    kind : str
        ``experiment``, ``load level`` or ``reading``.
    numbers : ndarray of int, shape (n_readings,)
        Fold of each reading.
    """

    kind: str
    numbers: IntArray


def levels(table: LoadTable) -> IntArray:
    """Return the number of each reading's load level, in rising torque."""
    torque = table.torque_nm
    order = np.argsort(torque, kind="stable")
    far = np.diff(torque[order]) > _LEVEL_SHARE * max(float(np.abs(torque).max()), 1e-300)
    numbers = np.zeros(len(torque), dtype=np.int64)
    numbers[order] = np.concatenate(([0], np.cumsum(far)))
    return numbers


def fold_kinds(table: LoadTable) -> tuple[Folds, ...]:
    """Return the ways to leave readings out that this table allows, the best one first.

    Parameters
    ----------
    table : LoadTable
        Readings.

    Returns
    -------
    tuple of Folds
        By experiment where there are three or more, by load level where there are four or more
        levels with more than one reading in the mean, by reading always.
    """
    kinds = []
    if len(table.names) > 2:
        kinds.append(Folds("experiment", table.experiment))
    numbers = levels(table)
    if numbers.max() > 2 and len(numbers) > numbers.max() + 1:
        kinds.append(Folds("load level", numbers))
    kinds.append(Folds("reading", np.arange(len(table), dtype=np.int64)))
    return tuple(kinds)


def held_out_nm(
    fit: LoadFit, base: FloatArray, folds: Folds, leave_out: tuple[int, ...] = ()
) -> FloatArray | None:
    """Predict each fold from all others.

    Parameters
    ----------
    fit : LoadFit
        Joint fit whose causes, with their shapes, are used.
    base : ndarray, shape (n, p)
        Columns of its baseline: torque, zeros, and torques of groups with a gain of their own.
    folds : Folds
        What is left out together.
    leave_out : tuple of int
        Indices of the terms that are left out of the prediction.

    Returns
    -------
    ndarray, shape (n_used,), or None
        Measured less predicted, N m; None where the rest of the readings does not fix what a fold
        needs.

    Notes
    -----
    The zero of an experiment is its own: of an experiment that is left out as a whole it is the
    mean of its residuals, and what stays is scaled to the variance of a prediction with a known
    zero.
    """
    table, used = fit.table, fit.table.used
    zeros = one_hot(table.experiment)[used]
    terms = [t for i, t in enumerate(fit.terms) if i not in leave_out]
    gains = np.delete(base, np.s_[1 : 1 + zeros.shape[1]], axis=1)
    known = np.hstack([gains, *(columns_of(t, table) for t in terms)])[used]
    size = np.sqrt(np.einsum("nk,nk->k", known, known))
    known = known / np.where(size > 0.0, size, 1.0)
    response = table.reading_v[used]
    numbers = folds.numbers[used]
    residual = np.full(len(response), np.nan)
    for number in np.unique(numbers):
        test = numbers == number
        predicted = _predict(known, zeros, response, test)
        if predicted is None:
            return None
        residual[test] = response[test] - predicted
    return residual / fit.slope_v_per_nm


def _predict(
    known: FloatArray, zeros: FloatArray, response: FloatArray, test: NDArray[np.bool_]
) -> FloatArray | None:
    """Return the prediction of the readings `test` from all others."""
    train = np.hstack([known, zeros])[~test]
    seen = zeros[~test].any(axis=0)
    asked = np.hstack([known, zeros])[test]
    solution, _, _, _ = np.linalg.lstsq(train, response[~test], rcond=_RANK)
    _, s, v = np.linalg.svd(train, full_matrices=True)
    rank = int((s > _RANK * s[0]).sum())
    blind = v[rank:].T
    whole = ~seen & zeros[test].any(axis=0)
    # a zero that no training reading shows is allowed to be unknown, nothing else is
    unseen = asked[:, : known.shape[1]] @ blind[: known.shape[1]]
    if float(np.abs(unseen).max(initial=0.0)) > _ALONE**0.5:
        return None
    predicted = asked @ solution
    for column in np.flatnonzero(whole):
        mine = zeros[test][:, column] > 0.0
        left = (response[test] - predicted)[mine]
        count = int(mine.sum())
        if count > 1:
            spread = (left - left.mean()) * np.sqrt(count / (count - 1.0))
            predicted[mine] = response[test][mine] - spread
    return np.asarray(predicted)


def gain_between_readings(
    before_nm: FloatArray, after_nm: FloatArray, units: IntArray, rng: np.random.Generator
) -> Gain:
    """Return the gain from one prediction to the other.

    Parameters
    ----------
    before_nm, after_nm : ndarray, shape (n,)
        Held-out residuals without and with a cause, N m.
    units : ndarray of int, shape (n,)
        What the bootstrap draws: experiments; readings where there are fewer than five.
    rng : Generator
        For the bootstrap.

    Returns
    -------
    Gain
    """
    old, new = before_nm**2, after_nm**2
    if len(np.unique(units)) < _LEAST_UNITS:
        units = np.arange(len(old), dtype=np.int64)
    which = one_hot(units)
    sums_old, sums_new = which.T @ old, which.T @ new
    pick = rng.integers(0, len(sums_old), (_DRAWS, len(sums_old)))
    drawn_old = np.maximum(sums_old[pick].sum(axis=1), np.finfo(float).tiny)
    low, high = np.percentile(1.0 - sums_new[pick].sum(axis=1) / drawn_old, (2.5, 97.5))
    mean_old = max(float(old.mean()), np.finfo(float).tiny)
    return Gain(
        float(np.sqrt(old.mean())),
        float(np.sqrt(new.mean())),
        float(1.0 - new.mean() / mean_old),
        (float(low), float(high)),
    )
