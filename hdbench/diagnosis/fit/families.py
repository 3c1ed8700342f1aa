"""Exact statistics of single terms, and their continuous refinement beside what is explained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.detect.exact import MIN_SHARE, solve_exactly
from hdbench.diagnosis.detect.steps import at_best_step
from hdbench.diagnosis.fit.possible import as_possible
from hdbench.diagnosis.fit.terms import (
    Term,
    moved_term,
    smooth_shapes,
    tangent_columns,
    term_columns,
)
from hdbench.diagnosis.fit.wholeshare import best_whole_share, one_by_definition
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.noise.whitened import Space
from hdbench.model import Cause, shape_bounds
from hdbench.records.trace import FloatArray

__all__ = [
    "Refined",
    "family_causes",
    "is_line",
    "is_step",
    "refine_term",
]

# rounds of the refinement, halvings of a step, and gain that ends it: a hundredth of a nat
_ROUNDS = 8
# a term that needs this many times the gain that its slopes promise, and a nat more, is given up
_PROMISED = 5.0
_SPARE = 2.0
# a delay is known to no better than this share of its standard deviation
_OWN_DELAY = 0.3
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
        True where the linear parameters lie in their domains; False too for a term given up.
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


def refine_term(space: Space, record: Record, term: Term, wanted: float = -np.inf) -> Refined:
    """Move the shape of a term to where it explains most of a residual.

    Parameters
    ----------
    space : Space
        Whitened residual without the term.
    record : Record
        Record.
    term : Term
        Term with a starting shape.
    wanted : float
        Statistic that is of use.

    Returns
    -------
    Refined
        Given up, with ``within`` False, where its slopes show that it will not come near what is
        wanted.

    Notes
    -----
    Variable projection by Gauss-Newton within the space: only the candidate moves.
    """
    if one_by_definition(term.cause):
        return Refined(*best_whole_share(space, record, term), 1, True)
    if "step_time_s" in term.shape:
        term = at_best_step(space, record, term)
    columns = term_columns(term, record)
    best = solve_exactly(space, columns)
    for _ in range(_ROUNDS if smooth_shapes(term) else 0):
        if best[1] == 0:
            break
        tangents = tangent_columns(term, best[2], columns, record)
        slopes = space.project(tangents)
        full = np.hstack([best[3], slopes])
        right = full.T @ space.residual
        moves = np.linalg.lstsq(full.T @ full, right, rcond=1e-10)[0]
        promised = float(moves @ right) - best[0]
        if best[0] + _PROMISED * promised + _SPARE < wanted:
            return Refined(term, best[0], best[1], False)
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
    if best[0] + _SPARE < wanted:
        return Refined(term, best[0], best[1], False)
    if "delay_s" in term.shape:
        return _by_its_delay(space, record, term)
    if term.cause.possible is not None:
        return Refined(*as_possible(space, record, term, best), True)
    return _in_domain(term, best, space)


def _by_its_delay(space: Space, record: Record, term: Term) -> Refined:
    """Return a shift of the signal formed at the delay that it has; none where there is no such.

    A shift formed at another delay than its own is a filter of the signal, and follows much that is
    no delay.
    """
    low, high = shape_bounds(term.cause, record.motion)["delay_s"][0]
    shape, best = dict(term.shape), solve_exactly(space, term_columns(term, record))
    for _ in range(_ROUNDS):
        delay = float(best[2][0])
        std = abs(delay) / max(np.sqrt(best[0]), 1.0)
        if best[1] == 0 or abs(delay - shape["delay_s"]) <= _OWN_DELAY * std:
            break
        shape["delay_s"] = float(np.clip(delay, low, high))
        best = solve_exactly(space, term_columns(replace(term, shape=shape), record))
    else:
        return Refined(term, best[0], best[1], False)
    return _in_domain(replace(term, shape=shape), best, space)


def _in_domain(
    term: Term, best: tuple[float, int, FloatArray, FloatArray], space: Space
) -> Refined:
    """Return a refined term; parameters that would fall below a bound of zero are left at zero."""
    statistic, dof, linear, left = best
    outside = np.array(
        [
            parameter.lower == 0.0 and not value >= 0.0
            for parameter, value in zip(term.cause.linear, linear, strict=True)
        ]
    )
    values = linear
    if outside.any() and not outside.all():
        part = left[:, ~outside]
        right = part.T @ space.residual
        solution = np.linalg.lstsq(part.T @ part, right, rcond=MIN_SHARE)[0]
        statistic, dof = float(solution @ right), int((~outside).sum())
        values = np.zeros(len(linear))
        values[~outside] = solution
    pairs = zip(term.cause.linear, values, strict=True)
    within = all(parameter.contains(float(value)) for parameter, value in pairs)
    return Refined(term, statistic, dof, within)


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
        solved = solve_exactly(space, columns)
        if solved[0] > statistic:
            return moved, columns, solved
        scale *= 0.4
    return None
