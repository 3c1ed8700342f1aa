"""Causes whose size follows from their shape: a limit takes all beyond it, a play all within it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.fit.terms import Term, fresh_columns, term_columns
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.noise.whitened import Space
from hdbench.model import Cause, shape_bounds
from hdbench.records.trace import FloatArray

__all__ = ["best_whole_share", "one_by_definition"]

# grid points of the size and of any further shape
_POINTS = 16
_FURTHER = 3
# rounds of Gauss-Newton, shorter steps in each, the longest step and that of a slope in the
# logarithm of a shape, and the gain that ends them: a hundredth of a nat
_ROUNDS = 12
_HALVINGS = 5
_STRIDE = 0.5
_SLOPE = 1e-4
_SETTLED = 0.02
_RANK = 1e-8
# a domain that begins at zero is searched down to this share of its end
_SMALLEST = 1e-4


def one_by_definition(cause: Cause) -> bool:
    """Return whether the one linear parameter of a cause is 1 where the cause is what it says.

    Parameters
    ----------
    cause : Cause
        Cause.

    Returns
    -------
    bool
    """
    return bool(cause.shape) and [p.name for p in cause.linear] == ["share"]


def best_whole_share(space: Space, record: Record, term: Term) -> tuple[Term, float]:
    """Return a term whose share is 1 at its best shape, and what it explains.

    Parameters
    ----------
    space : Space
        Whitened residual without the term.
    record : Record
        Record.
    term : Term
        Term; its shape does not matter.

    Returns
    -------
    term : Term
        At its best shape.
    statistic : float
        Fall of the whitened sum of squares, zero where it only rises.

    Notes
    -----
    With a free share a limit far below the torque is a gain error and one far above it a cube of
    any size. The sum of squares over the shapes may have several minima: a grid finds the lowest,
    Gauss-Newton over their logarithms refines it.
    """
    bounds = shape_bounds(term.cause, record.motion)
    if not all(bounds.values()):
        return term, 0.0
    axes = []
    for place, bands in enumerate(bounds.values()):
        low, high = bands[0][0], bands[-1][1]
        low = max(low, _SMALLEST * high)
        axes.append(np.linspace(np.log(low), np.log(high), _FURTHER if place else _POINTS))

    def at(point: tuple[float, ...]) -> Term:
        return replace(
            term, shape={n: float(np.exp(x)) for n, x in zip(bounds, point, strict=True)}
        )

    def rise(point: tuple[float, ...]) -> float:
        return float(_rises(space, term_columns(at(point), record))[0])

    points = [*product(*(tuple(axis.tolist()) for axis in axes))]
    table = np.empty((len(record.valid), len(points)), dtype=np.float32, order="F")
    for place, point in enumerate(points):
        table[:, place] = fresh_columns(at(point), record)[:, 0]
    values = dict(zip(points, _rises(space, table).tolist(), strict=True))
    start = min(values, key=lambda point: values[point])
    # the grid is in single precision, what follows is not
    values[start] = rise(start)
    limits = [(float(axis[0]), float(axis[-1])) for axis in axes]

    def slopes(point: tuple[float, ...]) -> FloatArray:
        here = term_columns(at(point), record)
        ahead = [
            term_columns(at((*point[:k], x + _SLOPE, *point[k + 1 :])), record)
            for k, x in enumerate(point)
        ]
        return space.project(np.hstack([column - here for column in ahead])) / _SLOPE

    def rest(point: tuple[float, ...]) -> FloatArray:
        return np.asarray(space.residual - space.project(term_columns(at(point), record))[:, 0])

    point = start
    for _ in range(_ROUNDS):
        tangents = slopes(point)
        move = np.asarray(np.linalg.lstsq(tangents, rest(point), rcond=_RANK)[0], dtype=np.float64)
        moved = _first_lower(rise, point, values, move, limits)
        if moved is None:
            break
        done = values[point] - values[moved] < _SETTLED
        point = moved
        if done:
            break
    return at(point), max(-values[point], 0.0)


def _rises(space: Space, table: FloatArray | NDArray[np.float32]) -> FloatArray:
    """Return by how much each column raises the whitened sum of squares, in its own precision."""
    white = space.whitener.apply(table)
    held = space.basis.astype(table.dtype, copy=False).T @ white
    squares = np.einsum("nk,nk->k", white, white) - np.einsum("qk,qk->k", held, held)
    common = space.residual.astype(table.dtype, copy=False) @ white
    return np.asarray(squares - 2.0 * common, dtype=np.float64)


def _first_lower(
    rise: Callable[[tuple[float, ...]], float],
    point: tuple[float, ...],
    values: dict[tuple[float, ...], float],
    move: FloatArray,
    limits: list[tuple[float, float]],
) -> tuple[float, ...] | None:
    """Return the first place along a step that is lower, and note its value; None without one."""
    scale = min(1.0, _STRIDE / max(float(np.abs(move).max()), 1e-300))
    for _ in range(_HALVINGS):
        moved = tuple(
            float(np.clip(x + scale * float(step), low, high))
            for x, step, (low, high) in zip(point, move, limits, strict=True)
        )
        value = rise(moved)
        if value < values[point]:
            values[moved] = value
            return moved
        scale *= 0.4
    return None
