"""Baseline and causes fitted together, shape parameters too, in coloured noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.fit.normal import Normal, normal_solve
from hdbench.diagnosis.fit.terms import (
    Term,
    moved_term,
    smooth_shapes,
    tangent_columns,
    term_columns,
)
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.noise.whitened import Whitener
from hdbench.records.trace import FloatArray

__all__ = ["JointFit", "fit_jointly"]

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
    explained : ndarray, shape (n, m)
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
    explained: FloatArray
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


@dataclass(frozen=True, slots=True)
class _State:
    """Linear solution at given shapes."""

    terms: tuple[Term, ...]
    raw: FloatArray
    white: FloatArray
    solution: FloatArray
    normal: Normal
    chi2: float


def _solve_at(
    terms: tuple[Term, ...],
    record: Record,
    whitener: Whitener,
    white_base: FloatArray,
    white_response: FloatArray,
) -> _State:
    blocks = [term_columns(term, record) for term in terms]
    raw = np.hstack([record.base, *blocks])
    white = np.hstack([white_base, *(whitener.apply(b) for b in blocks)])
    gram, right = white.T @ white, white.T @ white_response
    solution, _ = normal_solve(gram, right)
    first = white_base.shape[1]
    while (outside := _below_zero(terms, solution[first:])).any():
        # at its bound of zero a parameter's column takes no part
        place = first + np.flatnonzero(outside)
        white[:, place] = 0.0
        raw[:, place] = 0.0
        gram[place] = 0.0
        gram[:, place] = 0.0
        right[place] = 0.0
        solution, _ = normal_solve(gram, right)
        solution[np.diag(gram) == 0.0] = 0.0
    left = white_response - white @ solution
    edges = np.cumsum([white_base.shape[1], *(b.shape[1] for b in blocks)])
    slices = tuple(slice(int(a), int(b)) for a, b in pairwise(edges))
    normal = Normal(gram, right, float(white_response @ white_response), slices)
    return _State(terms, raw, white, solution, normal, float(left @ left))


def _below_zero(terms: tuple[Term, ...], linear: FloatArray) -> NDArray[np.bool_]:
    """Return which linear parameters are negative though their domain begins at zero."""
    lower = [parameter.lower for term in terms for parameter in term.cause.linear]
    return np.asarray((np.array(lower) == 0.0) & (linear < 0.0), dtype=bool)


def _tangents(state: _State, record: Record) -> FloatArray:
    parts = [
        tangent_columns(term, state.solution[s], state.raw[:, s], record)
        for term, s in zip(state.terms, state.normal.slices, strict=True)
    ]
    return np.hstack([np.zeros((len(state.raw), 0)), *parts])


def fit_jointly(
    record: Record, terms: Sequence[Term], whitener: Whitener, *, refine: bool = True
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
    response = record.response_nm
    white_base = whitener.apply(record.base)
    white_response = whitener.apply(response)

    def solve(candidates: tuple[Term, ...]) -> _State:
        return _solve_at(candidates, record, whitener, white_base, white_response)

    state, settled = solve(tuple(terms)), not refine
    for turn in range(_ROUNDS):
        tangents = _tangents(state, record)
        full = np.hstack([state.white, whitener.apply(tangents)])
        step, inverse = normal_solve(full.T @ full, full.T @ white_response)
        moves = step[state.white.shape[1] :]
        stds = np.sqrt(np.maximum(np.diag(inverse)[state.white.shape[1] :], 0.0))
        done = settled or not len(moves) or turn == _ROUNDS - 1
        if done or bool(np.all(np.abs(moves) <= _SETTLED * stds)):
            break
        better = _line_search(state, moves, record, solve)
        if better is None:
            break
        gained = state.chi2 - better.chi2
        state = better
        settled = gained < _GAINED
    return _collect(state, tangents, inverse, whitener, record)


def _line_search(
    state: _State,
    moves: FloatArray,
    record: Record,
    solve: Callable[[tuple[Term, ...]], _State],
) -> _State | None:
    """Return a state with a smaller sum of squares along the step, or None."""
    scale = 1.0
    for _ in range(_HALVINGS):
        moved, index = [], 0
        for term in state.terms:
            names = smooth_shapes(term)
            part = moves[index : index + len(names)] * scale
            index += len(names)
            moved.append(moved_term(term, dict(zip(names, part.tolist(), strict=True)), record))
        trial = solve(tuple(moved))
        if trial.chi2 < state.chi2 * (1.0 - 1e-12):
            return trial
        scale *= 0.5
    return None


def _collect(
    state: _State, tangents: FloatArray, inverse: FloatArray, whitener: Whitener, record: Record
) -> JointFit:
    free = max(1.0, float(whitener.used.sum() - len(inverse)))
    covariance = inverse * (state.chi2 / free)
    linear, covariances = [], []
    at = state.white.shape[1]
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
        state.raw @ state.solution,
        np.hstack([state.raw, tangents]),
        state.chi2,
        state.normal,
    )
