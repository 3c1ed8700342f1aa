"""Baseline and causes fitted together, shape parameters too, in coloured noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.fit.design import Design, Solved
from hdbench.diagnosis.fit.normal import Normal, normal_solve
from hdbench.diagnosis.fit.terms import (
    Term,
    moved_term,
    smooth_shapes,
    tangent_columns,
)
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.noise.whitened import Whitener
from hdbench.records.trace import FloatArray

__all__ = ["JointFit", "fit_jointly", "linear_fit"]

_ROUNDS = 12
_HALVINGS = 6
# a step smaller than this many standard deviations of the parameter ends the iteration
_SETTLED = 1e-3
# ... and so does a gain of less than a two-hundredth of a nat: no parameter moves by a tenth of one
_GAINED = 0.01


@dataclass(frozen=True, slots=True)
class JointFit:
    """Result of a joint fit.

    Parameters
    ----------
    terms : tuple of Term
        Causes with refined shapes.
    base : ndarray, shape (k,)
        Coefficients of baseline and nuisance.
    linear : tuple of ndarray
        Linear parameters of each term.
    covariances : tuple of ndarray
        Covariance of each term's linear, then shape parameters; shape rows are zero where a shape
        parameter has no slope.
    fitted_nm : ndarray, shape (n,)
        Baseline and causes, without what is fixed, N m.
    parts : tuple of ndarray
        Columns that span the fit: base, causes, slopes over the shape parameters.
    chi2 : float
        Sum of squares of the whitened residual.
    normal : Normal
        Normal equations of its linear parameters.
    """

    terms: tuple[Term, ...]
    base: FloatArray
    linear: tuple[FloatArray, ...]
    covariances: tuple[FloatArray, ...]
    fitted_nm: FloatArray
    parts: tuple[FloatArray, ...]
    chi2: float
    normal: Normal

    def loss(self, index: int) -> float:
        """Return what the loss of a term would cost, its shape and those of the others held.

        Parameters
        ----------
        index : int
            Index of the term.

        Returns
        -------
        float
            Rise of the whitened sum of squares, not below 0.
        """
        return max(self.normal.left_without(index) - self.chi2, 0.0)


def _tangents(state: Solved, record: Record) -> tuple[FloatArray, ...]:
    return tuple(
        tangent_columns(term, state.solution[part], block, record)
        for term, part, block in zip(state.terms, state.normal.slices, state.raw, strict=True)
    )


def fit_jointly(
    record: Record,
    terms: Sequence[Term],
    whitener: Whitener,
    *,
    refine: bool = True,
    enough: float = _GAINED,
) -> JointFit:
    """Fit baseline, nuisance and causes together.

    Parameters
    ----------
    record : Record
        Record.
    terms : sequence of Term
        Causes with starting shapes.
    whitener : Whitener
        Noise.
    refine : bool
        Refine the shape parameters too.
    enough : float
        Fall of the sum of squares in a round that ends the refinement.

    Returns
    -------
    JointFit

    Notes
    -----
    Variable projection by Gauss-Newton: at given shapes the linear parameters are solved for;
    then all are solved for again together with the slopes of the torque over the shapes, and the
    shapes move by what the slopes take up, halved until the sum of squares falls.
    The covariance is that of the last solution with slopes, times the mean square of the
    whitened residual: the delta method for every parameter at once.

    References
    ----------
    .. [1] G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413, doi:10.1137/0710036.
    """
    design = Design.of(record, whitener)
    state, settled = design.solve(tuple(terms)), not refine
    for turn in range(_ROUNDS):
        tangents = _tangents(state, record)
        step, inverse = normal_solve(*design.with_slopes(state, tangents))
        count = len(state.solution)
        moves = step[count:]
        stds = np.sqrt(np.maximum(np.diag(inverse)[count:], 0.0))
        done = settled or not len(moves) or turn == _ROUNDS - 1
        if done or bool(np.all(np.abs(moves) <= _SETTLED * stds)):
            break
        better = _line_search(state, moves, design)
        if better is None:
            break
        gained = state.chi2 - better.chi2
        state = better
        settled = gained < max(enough, _GAINED)
    return _collect(state, tangents, inverse, whitener, record)


def linear_fit(record: Record, terms: Sequence[Term], whitener: Whitener) -> FloatArray:
    """Fit baseline, nuisance and causes together at the shapes that they have.

    Parameters
    ----------
    record : Record
        Record.
    terms : sequence of Term
        Causes with their shapes.
    whitener : Whitener
        Noise.

    Returns
    -------
    ndarray, shape (n,)
        Baseline and causes as `JointFit.fitted_nm`, without the slopes that a covariance needs.
    """
    return _fitted(Design.of(record, whitener).solve(tuple(terms)), record)


def _line_search(state: Solved, moves: FloatArray, design: Design) -> Solved | None:
    """Return a state with a smaller sum of squares along the step, or None."""
    scale = 1.0
    for _ in range(_HALVINGS):
        moved, index = [], 0
        for term in state.terms:
            names = smooth_shapes(term)
            part = moves[index : index + len(names)] * scale
            index += len(names)
            moved.append(
                moved_term(term, dict(zip(names, part.tolist(), strict=True)), design.record)
            )
        trial = design.solve(tuple(moved), state)
        if trial.chi2 < state.chi2 * (1.0 - 1e-12):
            return trial
        scale *= 0.5
    return None


def _fitted(state: Solved, record: Record) -> FloatArray:
    """Return the torque of a solution."""
    fitted = record.base @ state.solution[: record.base.shape[1]]
    for block, part in zip(state.raw, state.normal.slices, strict=True):
        fitted += block @ state.solution[part]
    return np.asarray(fitted)


def _collect(
    state: Solved,
    tangents: tuple[FloatArray, ...],
    inverse: FloatArray,
    whitener: Whitener,
    record: Record,
) -> JointFit:
    free = max(1.0, float(whitener.used.sum() - len(inverse)))
    covariance = inverse * (state.chi2 / free)
    linear, covariances = [], []
    at = len(state.solution)
    for term, part in zip(state.terms, state.normal.slices, strict=True):
        smooth = smooth_shapes(term)
        index = list(range(part.start, part.stop)) + list(range(at, at + len(smooth)))
        at += len(smooth)
        n_linear, names = part.stop - part.start, [p.name for p in term.cause.shape]
        block = np.zeros((n_linear + len(names),) * 2)
        where = list(range(n_linear)) + [n_linear + names.index(name) for name in smooth]
        block[np.ix_(where, where)] = covariance[np.ix_(index, index)]
        linear.append(state.solution[part])
        covariances.append(block)
    return JointFit(
        state.terms,
        state.solution[: record.base.shape[1]],
        tuple(linear),
        tuple(covariances),
        _fitted(state, record),
        (record.base, *state.raw, *tangents),
        state.chi2,
        state.normal,
    )
