"""Causes whose linear parameters bound each other: a loop and what the gain holds of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdbench.diagnosis.fit.terms import Term, term_columns
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.noise.whitened import Space
from hdbench.model import shape_bounds
from hdbench.records.trace import FloatArray

__all__ = ["as_possible"]

# points over each shape where the linear parameters are at an edge of what can be
_POINTS = 12


def as_possible(
    space: Space, record: Record, term: Term, best: tuple[float, int, FloatArray, FloatArray]
) -> tuple[Term, float, int]:
    """Return a term whose linear parameters can be.

    Parameters
    ----------
    space : Space
        Whitened residual without the term.
    record : Record
        Record.
    term : Term
        Term at its best shape, of a cause that says what is possible.
    best : tuple
        As `solve_exactly` gives it for the term.

    Returns
    -------
    term : Term
        The same where its parameters can be, else at the shape that is best at an edge.
    statistic : float
        chi^2 with `dof` degrees of freedom at one shape without the effect.
    dof : int
        Linear parameters that are free.
    """
    possible = term.cause.possible
    if possible is None:
        return term, best[0], best[1]
    weights = np.linalg.lstsq(possible(record.motion, term.shape), best[2], rcond=None)[0]
    if best[1] == len(best[2]) and (np.all(weights >= 0.0) or np.all(weights <= 0.0)):
        return term, best[0], best[1]
    shapes = [dict(term.shape)]
    for name, bands in shape_bounds(term.cause, record.motion).items():
        for low, high in bands:
            places = np.geomspace(low, high, _POINTS).tolist()
            shapes += [{**term.shape, name: place} for place in places]
    found = (term, 0.0, 0)
    for shape in shapes:
        at = replace(term, shape=shape)
        for column in space.project(term_columns(at, record) @ possible(record.motion, shape)).T:
            size = float(column @ column)
            statistic = float(column @ space.residual) ** 2 / size if size > 0.0 else 0.0
            if statistic > found[1]:
                found = (at, statistic, 1)
    return found
