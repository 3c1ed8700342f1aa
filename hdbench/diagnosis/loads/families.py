"""Families of causes over grids of their shapes, on standing readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.shapes import DISCRETE, HELD, columns_of, shape_axis
from hdbench.diagnosis.loads.space import Space
from hdbench.diagnosis.loads.table import LoadTable, base_columns
from hdbench.model import Cause
from hdbench.records.trace import FloatArray

__all__ = ["Cell", "Family", "best_cell", "family_cells"]

_POINTS = 24
_POINTS_OF_TWO = 10
# neighbours on the grid whose spaces differ by less than this (sine squared) are one
_SAME_CELL = 1e-3
# neighbours on the grid are a fifth apart: halved so often they are a millionth apart
_HALVINGS = 18


@dataclass(frozen=True, slots=True)
class Cell:
    """One member of a family.

    Parameters
    ----------
    term : Term
        Cause and shape.
    directions : ndarray, shape (dof, rank)
        Orthonormal basis of what the fit leaves of it.
    """

    term: Term
    directions: FloatArray


@dataclass(frozen=True, slots=True)
class Family:
    """One cause over a grid of its shapes.

    Parameters
    ----------
    name : str
        Name of the cause.
    cells : tuple of Cell
        Members that these readings can show, at least one.
    """

    name: str
    cells: tuple[Cell, ...]


def family_cells(cause: Cause, table: LoadTable, space: Space) -> Family | None:
    """Return a cause over its grid, None where these readings show nothing of it.

    Parameters
    ----------
    cause : Cause
        Cause.
    table : LoadTable
        Readings.
    space : Space
        What the fit leaves.

    Returns
    -------
    Family or None
    """
    free = [p for p in cause.shape if p.name not in DISCRETE]
    points = _POINTS if len(free) < 2 else _POINTS_OF_TWO
    axes = [shape_axis(cause, table, p, points) for p in cause.shape]
    names = [p.name for p in cause.shape]
    held = any(name in HELD for name in names)
    cells: list[Cell] = []
    for values in product(*axes):
        term = Term(cause, dict(zip(names, map(float, values), strict=True)))
        directions = space.directions(columns_of(term, table))
        rank = directions.shape[1]
        if rank == 0 or rank >= space.dof:
            continue
        known = cells[-1].directions if cells and not held else directions[:, :0]
        if known.shape[1] == rank and space.sine_squared(known, directions) < _SAME_CELL:
            continue
        cells.append(Cell(term, directions))
    return Family(cause.name, tuple(cells)) if cells else None


def best_cell(family: Family, table: LoadTable, space: Space, slope_v_per_nm: float) -> Cell | None:
    """Return the member of a family that explains most of the residual.

    Parameters
    ----------
    family : Family
        Family.
    table : LoadTable
        Readings.
    space : Space
        Residual.
    slope_v_per_nm : float
        Reading per torque, V/(N m).

    Returns
    -------
    Cell or None
        Of a cause whose one linear parameter is a share that is 1 (a limit takes all of what is
        above it, a play all of what is within) the member with that share, None where no member has
        it.
    """
    cause = family.cells[0].term.cause
    held = [p.name for p in cause.shape if p.name in HELD]
    if not held:
        return max(family.cells, key=lambda cell: space.share(cell.directions))
    (name,) = held

    # what is taken is missing in the gain that the residual was formed with
    gain = np.linalg.pinv(base_columns(table)[space.used])[0]

    def share(value: float) -> float:
        column = columns_of(Term(cause, {**shape, name: value}), table)[space.used, 0]
        size = _size_of(column, space)
        slope = slope_v_per_nm - size * float(gain @ column)
        return size / slope if slope > 0.0 else 0.0

    for low, high in pairwise(family.cells):
        shape, ends = low.term.shape, (low.term.shape[name], high.term.shape[name])
        value = _where_one(share, ends)
        if value is None:
            continue
        term = Term(cause, {**shape, name: value})
        directions = space.directions(columns_of(term, table))
        return Cell(term, directions) if directions.shape[1] else None
    return None


def _size_of(column: FloatArray, space: Space) -> float:
    """Return the least-squares size of a column in the residual, V; 0 where it leaves nothing."""
    left = space.basis.T @ column
    square = float(left @ left)
    return float(left @ space.residual_v) / square if square > 0.0 else 0.0


def _where_one(share: Callable[[float], float], ends: tuple[float, float]) -> float | None:
    """Return where between two positive values a positive share is 1, None where it is not."""
    low, high = ends
    first, last = share(low), share(high)
    if not ((first - 1.0) * (last - 1.0) <= 0.0 < min(first, last)):
        return None
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        at = share(middle)
        if (first - 1.0) * (at - 1.0) <= 0.0:
            high = middle
        else:
            low, first = middle, at
    return float(np.sqrt(low * high))
