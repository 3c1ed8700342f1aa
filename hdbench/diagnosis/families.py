"""Exact statistics of single terms, and their continuous refinement beside what is explained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.record import Record
from hdbench.diagnosis.terms import (
    Term,
    moved_term,
    smooth_shapes,
    tangent_columns,
    term_columns,
)
from hdbench.diagnosis.whitened import Space
from hdbench.model import Cause, shape_bounds
from hdbench.records.trace import FloatArray

__all__ = [
    "Refined",
    "exact_statistic",
    "family_causes",
    "is_line",
    "is_step",
    "refine_term",
    "step_statistics",
]

# share of a column that must be left after the explained part was projected out
_MIN_SHARE = 0.01
# whitened size squared of a column of which 1000 N m are one standard deviation
_FAINTEST = 1e-6
# places of a step that are tried exactly
_STEP_TRIALS = 6
# rounds of the refinement, halvings of a step, and gain that ends it: a hundredth of a nat
_ROUNDS = 8
_HALVINGS = 4
_SETTLED = 0.02


@dataclass(frozen=True, slots=True)
class Refined:
    """A term at its best shape beside what is explained.

    Parameters
    ----------
    term : Term
        Term.
    statistic : float
        chi^2 with `dof` degrees of freedom at one shape without the effect.
    dof : int
        Linear parameters that the record can tell from what is explained.
    within : bool
        True where the linear parameters lie in their domains.
    """

    term: Term
    statistic: float
    dof: int
    within: bool


def is_line(cause: Cause) -> bool:
    """Return whether a cause is found by a scan: its one shape is an order or a frequency.

    Parameters
    ----------
    cause : Cause
        Cause.

    Returns
    -------
    bool
    """
    return len(cause.shape) == 1 and cause.shape[0].name in ("order", "frequency_hz")


def is_step(cause: Cause) -> bool:
    """Return whether a cause is a step of the zero at any time.

    Parameters
    ----------
    cause : Cause
        Cause.

    Returns
    -------
    bool
    """
    return [p.name for p in cause.shape] == ["step_time_s"] and len(cause.linear) == 1


def family_causes(record: Record, causes: tuple[Cause, ...]) -> tuple[Cause, ...]:
    """Return the causes to be tested as families on this record.

    Parameters
    ----------
    record : Record
        Record; its motion says what it can show.
    causes : tuple of Cause
        Catalogue.

    Returns
    -------
    tuple of Cause
        Those that add a torque, are no lines or steps and that the motion allows.
    """
    return tuple(
        c
        for c in causes
        if c.additive and not (is_line(c) or is_step(c)) and c.applicable(record.motion) is None
    )


def exact_statistic(space: Space, columns: FloatArray) -> tuple[float, int, FloatArray]:
    """Return the statistic of columns in a space, its dof and the linear parameters.

    Parameters
    ----------
    space : Space
        Whitened residual.
    columns : ndarray, shape (n, k)
        Columns, N m per unit.

    Returns
    -------
    statistic : float
        ``v' (X' M X)^+ v``.
    dof : int
        Rank of what is left of the columns.
    linear : ndarray, shape (k,)
        Linear parameters.
    """
    return _solve(space, columns)[:3]


def _solve(space: Space, columns: FloatArray) -> tuple[float, int, FloatArray, FloatArray]:
    """Return statistic, dof, linear parameters and what is left of the whitened columns."""
    left = space.project(columns)
    white_size = np.einsum("nk,nk->k", left, left)
    before = white_size + np.sum((space.pull_basis.T @ columns) ** 2, axis=0)
    # an effect of 1000 N m, the most that the catalogue allows, would stay below the noise
    if not np.all(before > _FAINTEST):
        return 0.0, 0, np.zeros(columns.shape[1]), left
    scale = 1.0 / np.sqrt(before)
    gram = (left.T @ left) * np.outer(scale, scale)
    values, vectors = np.linalg.eigh(gram)
    good = values > _MIN_SHARE
    right = vectors[:, good].T @ (scale * (left.T @ space.residual))
    linear = scale * (vectors[:, good] @ (right / values[good]))
    return float(np.sum(right**2 / values[good])), int(good.sum()), linear, left


def step_statistics(space: Space, pulls: FloatArray) -> FloatArray:
    """Return the statistic of a step of the zero at every sample.

    Parameters
    ----------
    space : Space
        Whitened residual.
    pulls : ndarray, shape (n, k)
        `Space.pull`, or draws of it.

    Returns
    -------
    ndarray, shape (n, k)
        chi^2 with one degree of freedom.

    Notes
    -----
    Sums from each sample to the end give all numerators at once; the whitened step's size is that
    of the kernel's sums, as if no sample were masked.
    """
    whitener = space.whitener
    count = len(space.pull)
    numerator = np.cumsum(pulls[::-1], axis=0)[::-1]
    sums = np.cumsum(whitener.kernel)
    rise = np.concatenate([sums, np.full(max(0, count - len(sums)), sums[-1])])[:count]
    size = np.cumsum(rise**2)[::-1] / whitener.std**2
    explained = np.cumsum(space.pull_basis[::-1], axis=0)[::-1]
    left = size - np.einsum("nk,nk->n", explained, explained)
    usable = (left > _MIN_SHARE * size) & space.whitener.valid
    weight = np.where(usable, 1.0 / np.maximum(left, 1e-300), 0.0)
    return np.asarray(numerator**2 * weight[:, None])


def _at_best_step(space: Space, record: Record, term: Term) -> Term:
    """Return a step in time moved to the sample where it fits best.

    A shape that jumps has no slope to follow: the best few of all samples are tried exactly, and
    the place it came from.
    """
    statistic = step_statistics(space, space.pull[:, None])[:, 0]
    tops = np.argsort(-statistic, kind="stable")[:_STEP_TRIALS]
    bounds = shape_bounds(term.cause, record.motion)["step_time_s"]
    times = [float(record.motion.time_s[at]) for at in tops]
    tried = [term] + [
        replace(term, shape={**term.shape, "step_time_s": time})
        for time in times
        if any(low <= time <= high for low, high in bounds)
    ]
    values = [exact_statistic(space, term_columns(t, record))[0] for t in tried]
    return tried[int(np.argmax(values))]


def refine_term(space: Space, record: Record, term: Term) -> Refined:
    """Move the shape of a term to where it explains most of a residual.

    Parameters
    ----------
    space : Space
        Whitened residual without the term.
    record : Record
        Record.
    term : Term
        Term with a starting shape.

    Returns
    -------
    Refined

    Notes
    -----
    Variable projection by Gauss-Newton within the space: only the candidate moves.
    """
    if "step_time_s" in term.shape:
        term = _at_best_step(space, record, term)
    columns = term_columns(term, record)
    best = _solve(space, columns)
    for _ in range(_ROUNDS if smooth_shapes(term) else 0):
        if best[1] == 0:
            break
        tangents = tangent_columns(term, best[2], columns, record)
        slopes = space.project(tangents)
        full = np.hstack([best[3], slopes])
        moves = np.linalg.lstsq(full.T @ full, full.T @ space.residual, rcond=1e-10)[0]
        moved = _along(
            space,
            record,
            term,
            dict(zip(smooth_shapes(term), moves[best[3].shape[1] :].tolist(), strict=True)),
            best[0],
        )
        if moved is None:
            break
        gain = moved[2][0] - best[0]
        term, columns, best = moved
        if gain < _SETTLED:
            break
    pairs = zip(term.cause.linear, best[2], strict=True)
    within = all(parameter.contains(float(value)) for parameter, value in pairs)
    return Refined(term, best[0], best[1], within)


def _along(
    space: Space, record: Record, term: Term, moves: Mapping[str, float], statistic: float
) -> tuple[Term, FloatArray, tuple[float, int, FloatArray, FloatArray]] | None:
    """Return the first term along a step that explains more, with columns and solution."""
    scale = 1.0
    for _ in range(_HALVINGS):
        moved = moved_term(term, {name: scale * move for name, move in moves.items()}, record)
        if moved.shape == term.shape:
            return None
        columns = term_columns(moved, record)
        solved = _solve(space, columns)
        if solved[0] > statistic:
            return moved, columns, solved
        scale *= 0.4
    return None
