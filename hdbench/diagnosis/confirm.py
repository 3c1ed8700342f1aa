"""The gain of a cause on blocks that its fit has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.families import is_line
from hdbench.diagnosis.jointfit import JointFit
from hdbench.diagnosis.record import Record
from hdbench.diagnosis.terms import tangent_columns, term_columns
from hdbench.diagnosis.whitened import Whitener
from hdbench.records.trace import FloatArray

__all__ = ["Gain", "HeldOut", "gain_between", "held_out_residuals"]

_FOLDS = 5
# contiguous blocks of each fold, spread over the record: a block of a single stretch would leave
# the training without the only speed, direction or level that shows an effect
_BLOCKS_PER_FOLD = 4
# gap between training and test, in samples at least; three times the noise's memory above that
_GAP = 30
# a longer memory, of slow noise, leaves no samples to train on if its whole is kept away
_MEMORY = 100
_DRAWS = 2000
# at least this many blocks in the bootstrap, else its interval is no interval
_MIN_BLOCKS = 20
_RANK = 1e-10
# weight of plain samples beside whitened ones
_ANCHOR = 1e-3


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Residual of predictions for blocks that were left out of the fit.

    Parameters
    ----------
    residual_nm : ndarray, shape (n,)
        Measured less predicted, N m; zero where not valid.
    valid : ndarray of bool, shape (n,)
        Samples that were predicted.
    chi2 : float
        Sum of squares of the whitened residual.
    """

    residual_nm: FloatArray
    valid: NDArray[np.bool_]
    chi2: float

    @property
    def rms_nm(self) -> float:
        """Root mean square, N m."""
        return float(np.sqrt(np.mean(self.residual_nm[self.valid] ** 2)))


@dataclass(frozen=True, slots=True)
class Gain:
    """Held-out residual without and with a cause.

    Parameters
    ----------
    heldout_rms_before_nm, heldout_rms_after_nm : float
        Root mean square without and with it, N m.
    explained_fraction : float
        One less the ratio of the mean squares.
    interval : tuple of float
        95 % interval of `explained_fraction` by a paired block bootstrap.
    """

    heldout_rms_before_nm: float
    heldout_rms_after_nm: float
    explained_fraction: float
    interval: tuple[float, float]

    def to_dict(self) -> dict[str, object]:
        """Return the gain as the contract writes it."""
        return {
            "heldout_rms_before_nm": self.heldout_rms_before_nm,
            "heldout_rms_after_nm": self.heldout_rms_after_nm,
            "explained_fraction": self.explained_fraction,
            "interval": list(self.interval),
        }


def held_out_residuals(
    record: Record, fit: JointFit, whitener: Whitener, leave_out: Sequence[int | None]
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

    Returns
    -------
    list of HeldOut

    Notes
    -----
    Twenty contiguous blocks; every fifth is one fold. A fold is predicted with linear parameters,
    orders and frequencies fitted to the other folds; orders and frequencies by the slopes of the
    torque about the joint fit, other shapes stay at it. Samples within the noise's memory of a
    block, 30 at least, do not train.
    """
    design, owner = _design(record, fit)
    response = record.response_nm
    white, right = _anchored(record, fit, whitener, design)
    samples = np.flatnonzero(record.valid)
    gap = max(_GAP, 3 * min(len(whitener.kernel), _MEMORY))
    blocks = np.array_split(samples, _FOLDS * _BLOCKS_PER_FOLD)
    gram, vector, n = white.T @ white, white.T @ right, len(response)
    residuals = np.zeros((len(leave_out), len(response)))
    for fold in range(_FOLDS):
        own, target = gram.copy(), vector.copy()
        for around in _surroundings(blocks[fold::_FOLDS], gap):
            for rows in (around, slice(around.start + n, around.stop + n)):
                own -= white[rows].T @ white[rows]
                target -= white[rows].T @ right[rows]
        for row, left in enumerate(leave_out):
            solution = _solution(own, target, _kept(owner, left, fit))
            for block in blocks[fold::_FOLDS]:
                residuals[row, block] = response[block] - design[block] @ solution
    return [
        HeldOut(residual, record.valid, float(np.sum(whitener.apply(residual) ** 2)))
        for residual in residuals
    ]


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


def _design(record: Record, fit: JointFit) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return scaled columns and the index of the cause that each belongs to, -1 for the base."""
    parts, owner = [record.base], [-1] * record.base.shape[1]
    for index, (term, linear) in enumerate(zip(fit.terms, fit.linear, strict=True)):
        columns = term_columns(term, record)
        parts.append(columns)
        if is_line(term.cause):
            parts.append(tangent_columns(term, linear, columns, record))
        owner += [index] * (sum(p.shape[1] for p in parts) - len(owner))
    design = np.hstack(parts)
    size = np.sqrt(np.einsum("nk,nk->k", design, design))
    return design / np.where(size > 0.0, size, 1.0), np.array(owner, dtype=np.int64)


def _kept(owner: NDArray[np.int64], left: int | None, fit: JointFit) -> NDArray[np.bool_]:
    """Return which columns stay."""
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


def _surroundings(blocks: list[NDArray[np.int64]], gap: int) -> list[slice]:
    """Return the blocks with their gaps, none of which overlap."""
    out: list[slice] = []
    for block in blocks:
        start = max(0, int(block[0]) - gap, out[-1].stop if out else 0)
        out.append(slice(start, max(start, int(block[-1]) + gap + 1)))
    return out


def _block_sums(values: FloatArray, length: int) -> FloatArray:
    edges = np.arange(0, len(values), length)
    return np.asarray(np.add.reduceat(values, edges))


def gain_between(before: HeldOut, after: HeldOut, record: Record, rng: np.random.Generator) -> Gain:
    """Return the gain from one prediction to the other.

    Parameters
    ----------
    before, after : HeldOut
        Predictions without and with a cause.
    record : Record
        Record; an output turn is the length of a bootstrap block where 20 of them fit.
    rng : Generator
        For the bootstrap.

    Returns
    -------
    Gain

    References
    ----------
    .. [1] H. R. Kuensch, Ann. Statist. 17 (1989) 1217, doi:10.1214/aos/1176347265.
    """
    old = before.residual_nm[before.valid] ** 2
    new = after.residual_nm[after.valid] ** 2
    travelled = np.abs(np.diff(record.motion.output_angle_rad[record.valid])).sum() / (2.0 * np.pi)
    turn = len(old) / travelled if travelled > 0.0 else np.inf
    length = int(np.clip(turn, 1, max(1, len(old) // _MIN_BLOCKS)))
    sums_old, sums_new = _block_sums(old, length), _block_sums(new, length)
    pick = rng.integers(0, len(sums_old), (_DRAWS, len(sums_old)))
    fractions = 1.0 - sums_new[pick].sum(axis=1) / sums_old[pick].sum(axis=1)
    low, high = np.percentile(fractions, (2.5, 97.5))
    return Gain(
        before.rms_nm,
        after.rms_nm,
        float(1.0 - new.mean() / old.mean()),
        (float(low), float(high)),
    )
