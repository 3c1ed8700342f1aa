"""The gain of a cause on blocks that its fit has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.families import is_line
from hdbench.diagnosis.jointfit import JointFit
from hdbench.diagnosis.record import Record
from hdbench.diagnosis.terms import tangent_columns, term_columns
from hdbench.diagnosis.whitened import Whitener
from hdbench.records.trace import FloatArray

__all__ = ["Gain", "HeldOut", "gain_between", "held_out_residual"]

_FOLDS = 5
# contiguous blocks of each fold, spread over the record: a block of a single stretch would leave
# the training without the only speed, direction or level that shows an effect
_BLOCKS_PER_FOLD = 4
# gap between training and test, in samples at least; three times the noise's memory above that
_GAP = 30
_DRAWS = 2000
# at least this many blocks in the bootstrap, else its interval is no interval
_MIN_BLOCKS = 20
_RANK = 1e-10


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Residual of predictions for blocks that were left out of the fit.

    Parameters
    ----------
    residual_nm : ndarray, shape (n,)
        Measured less predicted, N m; zero where not valid.
    valid : ndarray of bool, shape (n,)
        Samples that were predicted.
    """

    residual_nm: FloatArray
    valid: NDArray[np.bool_]

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


def held_out_residual(
    record: Record, fit: JointFit, whitener: Whitener, leave_out: int | None = None
) -> HeldOut:
    """Predict each fifth of the record from the rest of it.

    Parameters
    ----------
    record : Record
        Record.
    fit : JointFit
        Joint fit whose causes are used.
    whitener : Whitener
        Noise.
    leave_out : int or None
        Index of a cause that is left out of the prediction.

    Returns
    -------
    HeldOut

    Notes
    -----
    Twenty contiguous blocks; every fifth is one fold. A fold is predicted with linear parameters,
    orders and frequencies fitted to the other folds; orders and frequencies by the slopes of the
    torque about the joint fit, other shapes stay at it. Samples within the noise's memory of a
    block, 30 at least, do not train.
    """
    parts = [record.base]
    for index, (term, linear) in enumerate(zip(fit.terms, fit.linear, strict=True)):
        if index != leave_out:
            columns = term_columns(term, record)
            parts.append(columns)
            if is_line(term.cause):
                parts.append(tangent_columns(term, linear, columns, record))
    design = np.hstack(parts)
    size = np.sqrt(np.einsum("nk,nk->k", design, design))
    design = design / np.where(size > 0.0, size, 1.0)
    response = record.response_nm
    white, white_response = whitener.apply(design), whitener.apply(response)
    total = white.T @ white
    right = white.T @ white_response
    residual = np.zeros(len(response))
    samples = np.flatnonzero(record.valid)
    gap = max(_GAP, 3 * len(whitener.kernel))
    blocks = np.array_split(samples, _FOLDS * _BLOCKS_PER_FOLD)
    for fold in range(_FOLDS):
        gram, vector = total.copy(), right.copy()
        for around in _surroundings(blocks[fold::_FOLDS], gap):
            gram -= white[around].T @ white[around]
            vector -= white[around].T @ white_response[around]
        values, vectors = np.linalg.eigh(gram)
        good = values > _RANK * values[-1]
        solution = (vectors[:, good] / values[good]) @ (vectors[:, good].T @ vector)
        for block in blocks[fold::_FOLDS]:
            residual[block] = response[block] - design[block] @ solution
    return HeldOut(residual, record.valid)


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
