"""Causes held against conditions that their fit has not seen: speeds, directions, loads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.answer.records import FORETOLD, Condition, LeftOut
from hdbench.diagnosis.confirm.predicted import design_of, kept_columns
from hdbench.diagnosis.fit.jointfit import JointFit
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.curves import equal_bins
from hdbench.diagnosis.noise.coarse import noise_width
from hdbench.diagnosis.noise.whitened import Whitener
from hdbench.records.trace import FloatArray

__all__ = ["Condition", "LeftOut", "conditions_of", "left_out_gains"]

# levels of speed and of load
_LEVELS = 5
# a direction is a speed above this share of the largest one, in this share of the samples at least
_TURNING = 0.02
_LEAST = 0.05
# a load that changes by less than this, N m, has one level
_SAME_LOAD_NM = 1.0
# directions whose share of the normal matrix is below this are as good as unknown
_RANK = 1e-9
# a condition can tell where the cause claims seven standard deviations in it and the other
# conditions foretell these to a third of a standard deviation each
_CLAIMED = 50.0
# a cause that is foretold at thrice its size loses three times what it claims; a greater loss is of
# the other terms, which the conditions that are left do not hold where the missing one is
_OWN_LOSS = 3.0


def conditions_of(record: Record) -> tuple[Condition, ...]:
    """Return the conditions that a record holds.

    Parameters
    ----------
    record : Record
        Record.

    Returns
    -------
    tuple of Condition
        Levels of the magnitude of speed, both directions, levels of the measured load; none on
        an axis that does not change.
    """
    motion, valid = record.motion, record.valid
    speed = np.where(valid, motion.velocity_rad_s, 0.0)
    found = _levels(np.abs(speed), valid, "velocity", "rad/s")
    # at rest noise makes the direction: what follows the speed cannot be foretold there
    rest = noise_width(speed, valid)
    found = [level for level in found if level.high > rest]
    line = _TURNING * float(np.abs(speed).max())
    ways = [(sign, valid & (sign * speed > line)) for sign in (-1.0, 1.0)]
    if all(float(mask.sum()) > _LEAST * float(valid.sum()) for _, mask in ways):
        found += [Condition("direction", "1", sign, sign, mask) for sign, mask in ways]
    load = np.where(valid, motion.applied_nm, 0.0)
    if motion.load_torque_nm is not None and float(np.ptp(load[valid])) > _SAME_LOAD_NM:
        found += _levels(load, valid, "torque", "N m")
    return tuple(found)


def _levels(values: FloatArray, valid: NDArray[np.bool_], axis: str, unit: str) -> list[Condition]:
    """Return levels that hold equal shares of the samples."""
    return [
        Condition(axis, unit, float(values[mask].min()), float(values[mask].max()), mask)
        for mask in equal_bins(values, valid, _LEVELS)
    ]


def left_out_gains(
    record: Record, fit: JointFit, whitener: Whitener, causes: Sequence[int]
) -> list[tuple[LeftOut, ...]]:
    """Predict each condition from all others, with and without a cause.

    Parameters
    ----------
    record : Record
        Record.
    fit : JointFit
        Joint fit; shapes but orders and frequencies stay at it.
    whitener : Whitener
        Noise.
    causes : sequence of int
        Indices of the causes.

    Returns
    -------
    list of tuple of LeftOut
        For each cause the conditions that can tell.
    """
    if not causes:
        return []
    columns, owner = design_of(record, fit)
    white, right = whitener.apply(columns), whitener.apply(record.response_nm)
    gram, target = white.T @ white, white.T @ right
    full = _predict(gram, target, np.ones(len(owner), dtype=bool))[0]
    found: list[list[LeftOut]] = [[] for _ in causes]
    for condition in conditions_of(record):
        rows = white[condition.inside]
        part = rows.T @ rows
        own, trained = gram - part, target - rows.T @ right[condition.inside]
        every = np.ones(len(owner), dtype=bool)
        with_all = _predict(own, trained, every)
        for place, cause in enumerate(causes):
            kept = kept_columns(owner, cause, fit)
            claim = rows @ _claimed(gram, target, kept)
            claimed = float(claim @ claim)
            without = _predict(own, trained, kept)
            spread = float(np.sum(part * with_all[1]) - np.sum(part * without[1]))
            if not (claimed > _CLAIMED and spread < FORETOLD * claimed):
                continue
            left = [right[condition.inside] - rows @ p[0] for p in (without, with_all)]
            gain = float(left[0] @ left[0] - left[1] @ left[1])
            if not gain > -_OWN_LOSS * claimed:
                gain = _alone(own, trained, rows, right[condition.inside], (full, kept))
            found[place].append(LeftOut(condition, 0.5 * gain, 0.5 * claimed))
    return [tuple(one) for one in found]


def _predict(
    gram: FloatArray, target: FloatArray, kept: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Return coefficients and their covariance; what cannot be told has a large one."""
    values, vectors = np.linalg.eigh(gram[np.ix_(kept, kept)])
    inverse = (vectors / np.maximum(values, _RANK * values[-1])) @ vectors.T
    solution, covariance = np.zeros(len(kept)), np.zeros_like(gram)
    solution[kept] = inverse @ target[kept]
    covariance[np.ix_(kept, kept)] = inverse
    return solution, covariance


def _alone(
    gram: FloatArray,
    target: FloatArray,
    rows: FloatArray,
    right: FloatArray,
    fitted: tuple[FloatArray, NDArray[np.bool_]],
) -> float:
    """Return what a cause gains where all other terms stay as all conditions have them."""
    full, kept = fitted
    others = np.where(kept, full, 0.0)
    own = _predict(gram, target - gram @ others, ~kept)[0]
    before = right - rows @ others
    after = before - rows @ own
    return float(before @ before - after @ after)


def _claimed(gram: FloatArray, target: FloatArray, kept: NDArray[np.bool_]) -> FloatArray:
    """Return the coefficients of a cause, less those of the others that would stand in for it."""
    solution = _predict(gram, target, np.ones(len(kept), dtype=bool))[0]
    solution = np.where(kept, 0.0, solution)
    stand_in = _predict(gram, gram @ solution, kept)[0]
    return np.asarray(solution - stand_in)
