"""Predictions of blocks that a fit has not seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.confirm.gain import HeldOut
from hdbench.diagnosis.fit.families import is_line
from hdbench.diagnosis.fit.jointfit import JointFit
from hdbench.diagnosis.fit.terms import tangent_columns, term_columns
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.noise.gaps import bridges
from hdbench.diagnosis.noise.whitened import Whitener
from hdbench.records.trace import FloatArray

__all__ = ["design_of", "held_out_residuals", "kept_columns"]

_FOLDS = 5
# contiguous blocks of each fold, spread over the record: a block of a single stretch would leave
# the training without the only speed, direction or level that shows an effect
_BLOCKS_PER_FOLD = 4
# gap between training and test, in samples at least; three times the noise's memory above that
_GAP = 30
# a longer memory, of slow noise, leaves no samples to train on if its whole is kept away
_MEMORY = 100
_RANK = 1e-10
# owner of columns that take no part in a prediction
_ABSENT = -2
# weight of plain samples beside whitened ones
_ANCHOR = 1e-3


def held_out_residuals(
    record: Record,
    fit: JointFit,
    whitener: Whitener,
    leave_out: Sequence[int | None],
    *,
    walking: bool = False,
) -> list[HeldOut]:
    """Predict each fifth of the record from the rest of it.

    Parameters
    ----------
    record : Record
        Record.
    fit : JointFit
        Joint fit whose causes are used.
    whitener : Whitener
        Noise.
    leave_out : sequence of int or None
        Index of a cause that is left out of each prediction; None for all causes, -1 for the
        causes that the model did not hold before.
    walking : bool
        Whether a random walk of the zero is predicted too: between what the folds that train leave
        on both sides of a block, by a straight line; beyond the ends of the record it stands still.

    Returns
    -------
    list of HeldOut
        Their `chi2` is of the residual with the walk in it, which the whitener takes for noise.

    Notes
    -----
    Twenty contiguous blocks; every fifth is one fold. A fold is predicted with linear parameters,
    orders and frequencies fitted to the other folds; orders and frequencies by the slopes of the
    torque about the joint fit, other shapes stay at it. Samples within the noise's memory of a
    block, 30 at least and no more than a block, do not train.

    Least squares alone would predict without bounds where a fold holds the only samples that show
    a part of an effect. The linear parameters of a cause have a normal distribution as prior, in
    which its whitened torque over the record is as large as the other folds show it to be, alike
    in all directions (the g-prior with an empirical g).

    References
    ----------
    .. [1] E. I. George, D. P. Foster, Biometrika 87 (2000) 731, doi:10.1093/biomet/87.4.731.
    """
    design, owner = design_of(record, fit)
    response = record.response_nm
    white, right = _anchored(record, fit, whitener, design)
    samples = np.flatnonzero(record.valid)
    blocks = np.array_split(samples, _FOLDS * _BLOCKS_PER_FOLD)
    # no further than a block: on a short record nothing would be left to train on
    gap = min(max(_GAP, 3 * min(len(whitener.kernel), _MEMORY)), len(blocks[0]))
    gram, vector, n = white.T @ white, white.T @ right, len(response)
    residuals = np.zeros((len(leave_out), n))
    walks = np.zeros_like(residuals)
    for fold in range(_FOLDS):
        own, target = gram.copy(), vector.copy()
        apart = _surroundings(blocks[fold::_FOLDS], gap)
        for around in apart:
            for rows in (around, slice(around.start + n, around.stop + n)):
                own -= white[rows].T @ white[rows]
                target -= white[rows].T @ right[rows]
        for row, left in enumerate(leave_out):
            kept = kept_columns(owner, left, fit)
            prior = _prior(gram, own, target, np.where(kept, owner, _ABSENT))
            solution = _solution(own + prior, target, kept)
            for block in blocks[fold::_FOLDS]:
                residuals[row, block] = response[block] - design[block] @ solution
            if walking:
                walk = _walk_between(response - design @ solution, record, apart, whitener)
                for block in blocks[fold::_FOLDS]:
                    walks[row, block] = walk[block]
    return [
        HeldOut(residual - walk, record.valid, float(np.sum(whitener.apply(residual) ** 2)))
        for residual, walk in zip(residuals, walks, strict=True)
    ]


def _walk_between(
    residual: FloatArray, record: Record, apart: list[slice], whitener: Whitener
) -> FloatArray:
    """Return a residual with straight lines over the samples that do not train."""
    seen = record.valid.copy()
    for around in apart:
        seen[around] = False
    over = bridges(seen, whitener.reach)
    return residual if over is None else np.asarray(over.cross(residual[:, None]))[:, 0]


def _anchored(
    record: Record, fit: JointFit, whitener: Whitener, design: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return whitened columns and response, and below them both as they are with little weight.

    Noise without a level of its own (a random walk) leaves the whitened zero next to nothing: the
    plain samples then hold it, while they add a thousandth where the noise is white.
    """
    response = record.response_nm
    spread = float(np.std((response - fit.fitted_nm)[record.valid]))
    weight = np.sqrt(_ANCHOR) / spread if spread > 0.0 else 0.0
    seen = np.where(record.valid, weight, 0.0)
    white = np.vstack([whitener.apply(design), design * seen[:, None]])
    return white, np.concatenate([whitener.apply(response), response * seen])


def design_of(record: Record, fit: JointFit) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return scaled columns and the index of the cause that each belongs to, -1 for the base.

    Parameters
    ----------
    record : Record
        Record.
    fit : JointFit
        Joint fit; lines have the slopes over their places too.

    Returns
    -------
    columns : ndarray, shape (n, k)
    owner : ndarray of int, shape (k,)
    """
    parts, owner = [record.base], [-1] * record.base.shape[1]
    first: dict[str, int] = {}
    for place, (term, linear) in enumerate(zip(fit.terms, fit.linear, strict=True)):
        index = first.setdefault(term.cause.name, place) if term.form else place
        first.setdefault(term.cause.name, place)
        columns = term_columns(term, record)
        parts.append(columns)
        if is_line(term.cause):
            parts.append(tangent_columns(term, linear, columns, record))
        owner += [index] * (sum(p.shape[1] for p in parts) - len(owner))
    design = np.hstack(parts)
    size = np.sqrt(np.einsum("nk,nk->k", design, design))
    return design / np.where(size > 0.0, size, 1.0), np.array(owner, dtype=np.int64)


def kept_columns(owner: NDArray[np.int64], left: int | None, fit: JointFit) -> NDArray[np.bool_]:
    """Return which columns stay.

    Parameters
    ----------
    owner : ndarray of int, shape (k,)
        As `design_of` gives it.
    left : int or None
        Cause that is left out; None for none, -1 for all that the model did not hold before.
    fit : JointFit
        Joint fit.

    Returns
    -------
    ndarray of bool, shape (k,)
    """
    if left is None:
        return np.ones(len(owner), dtype=bool)
    if left >= 0:
        return np.asarray(owner != left)
    known = [index for index, term in enumerate(fit.terms) if term.known]
    return np.isin(owner, [-1, *known])


def _solution(gram: FloatArray, target: FloatArray, kept: NDArray[np.bool_]) -> FloatArray:
    """Return the coefficients with those that are not kept at zero."""
    values, vectors = np.linalg.eigh(gram[np.ix_(kept, kept)])
    good = values > _RANK * values[-1]
    solution = np.zeros(len(kept))
    solution[kept] = (vectors[:, good] / values[good]) @ (vectors[:, good].T @ target[kept])
    return solution


def _prior(
    gram: FloatArray, own: FloatArray, target: FloatArray, owner: NDArray[np.int64]
) -> FloatArray:
    """Return the precision of the prior of every cause's parameters, from training samples alone.

    Parameters
    ----------
    gram : ndarray, shape (k, k)
        Whitened design of the whole record times itself.
    own, target : ndarray, shape (k, k) and (k,)
        The same of the training samples, and with the response.
    owner : ndarray of int, shape (k,)
        Cause of each column, -1 for the base, -2 for columns that do not take part.

    Returns
    -------
    ndarray, shape (k, k)
        Zero for the base.
    """
    kept = owner != _ABSENT
    precision = np.zeros_like(gram)
    with_all = _explained(own, target, kept)
    for cause in np.unique(owner[owner >= 0]):
        columns = np.flatnonzero(owner == cause)
        count = len(columns)
        energy = with_all - _explained(own, target, kept & (owner != cause))
        others = np.flatnonzero(kept & (owner != cause))
        inside = _beside(gram, columns, others)
        trained = _beside(own, columns, others)
        seen = float(np.trace(np.linalg.pinv(inside, rcond=_RANK, hermitian=True) @ trained))
        # what noise alone would explain is no size of the effect
        precision[np.ix_(columns, columns)] = seen / max(energy - count, count) * inside
    return precision


def _explained(gram: FloatArray, target: FloatArray, kept: NDArray[np.bool_]) -> float:
    """Return the whitened sum of squares that columns explain."""
    return float(target @ _solution(gram, target, kept))


def _beside(gram: FloatArray, columns: NDArray[np.int64], others: NDArray[np.int64]) -> FloatArray:
    """Return what is left of the Gram matrix of columns beside others."""
    cross = gram[np.ix_(others, columns)]
    return np.asarray(
        gram[np.ix_(columns, columns)]
        - cross.T
        @ np.linalg.pinv(gram[np.ix_(others, others)], rcond=_RANK, hermitian=True)
        @ cross
    )


def _surroundings(blocks: list[NDArray[np.int64]], gap: int) -> list[slice]:
    """Return the blocks with their gaps, none of which overlap."""
    out: list[slice] = []
    for block in blocks:
        start = max(0, int(block[0]) - gap, out[-1].stop if out else 0)
        out.append(slice(start, max(start, int(block[-1]) + gap + 1)))
    return out
