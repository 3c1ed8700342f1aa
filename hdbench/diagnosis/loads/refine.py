"""Shapes of causes by least squares, with gain, zeros and sizes solved for at every step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.shapes import DISCRETE, HELD, columns_of, shape_limits
from hdbench.diagnosis.loads.table import LoadTable
from hdbench.records.trace import FloatArray

__all__ = ["design_matrix", "refined_terms", "scaled_solve"]

# directions whose share of the scaled columns falls below this cannot be resolved
_RANK = 1e-9
# step of the slopes, as a share of the domain: fine beside the grid, coarse beside rounding
_STEP = 1e-4
_CALLS = 30


@dataclass(frozen=True, slots=True)
class _Free:
    """A shape parameter that moves: place of its term, name and bounds."""

    place: int
    name: str
    low: float
    high: float

    def value(self, share: float) -> float:
        """Return the value at a share of the domain, in equal ratios where it is positive."""
        low, high = self.low, self.high
        real = low * (high / low) ** share if low > 0.0 else low + (high - low) * share
        return float(np.clip(real, low, high))

    def share(self, value: float) -> float:
        """Return the share of the domain at a value."""
        low, high = self.low, self.high
        if low > 0.0:
            return float(np.log(value / low) / np.log(high / low))
        return (value - low) / (high - low)


def scaled_solve(design: FloatArray, response: FloatArray) -> FloatArray:
    """Return the least-squares solution of least norm in scaled columns.

    Parameters
    ----------
    design : ndarray, shape (n, k)
        Columns.
    response : ndarray, shape (n,)
        What they explain.

    Returns
    -------
    ndarray, shape (k,)
    """
    size = np.sqrt(np.einsum("nk,nk->k", design, design))
    size = np.where(size > 0.0, size, 1.0)
    solution, _, _, _ = np.linalg.lstsq(design / size, response, rcond=_RANK)
    return np.asarray(solution / size)


def design_matrix(base: FloatArray, terms: Sequence[Term], table: LoadTable) -> FloatArray:
    """Return the columns of a baseline and of terms.

    Parameters
    ----------
    base : ndarray, shape (n, p)
        Columns of the baseline.
    terms : sequence of Term
        Terms.
    table : LoadTable
        Readings.

    Returns
    -------
    ndarray, shape (n, p + k)
        k linear parameters of all terms.
    """
    return np.hstack([base, *(columns_of(term, table) for term in terms)])


def _free_shapes(terms: Sequence[Term], table: LoadTable) -> list[_Free]:
    free = []
    for place, term in enumerate(terms):
        for parameter in term.cause.shape:
            if parameter.name in (*DISCRETE, *HELD):
                continue
            value = term.shape[parameter.name]
            bands = shape_limits(term.cause, table, parameter)
            inside = [(low, high) for low, high in bands if low <= value <= high]
            free += [_Free(place, parameter.name, low, high) for low, high in inside[:1]]
    return free


def _moved(terms: Sequence[Term], free: list[_Free], shares: FloatArray) -> list[Term]:
    moved = list(terms)
    for one, share in zip(free, shares.tolist(), strict=True):
        shape = {**moved[one.place].shape, one.name: one.value(share)}
        moved[one.place] = replace(moved[one.place], shape=shape)
    return moved


def refined_terms(terms: Sequence[Term], base: FloatArray, table: LoadTable) -> tuple[Term, ...]:
    """Return the terms with shapes of least squares near where they are.

    Parameters
    ----------
    terms : sequence of Term
        Terms with starting shapes.
    base : ndarray, shape (n, p)
        Columns of the baseline.
    table : LoadTable
        Readings.

    Returns
    -------
    tuple of Term
        As they were where nothing better is near.
    """
    from scipy.optimize import least_squares

    free = _free_shapes(terms, table)
    if not free:
        return tuple(terms)
    response = table.reading_v[table.used]
    scale = float(np.sqrt(response @ response)) or 1.0

    def residual(shares: FloatArray) -> FloatArray:
        design = design_matrix(base, _moved(terms, free, shares), table)[table.used]
        return np.asarray((response - design @ scaled_solve(design, response)) / scale)

    start = np.clip([one.share(terms[one.place].shape[one.name]) for one in free], 0.0, 1.0)
    found = least_squares(
        residual, start, bounds=(0.0, 1.0), diff_step=np.full(len(start), _STEP), max_nfev=_CALLS
    )
    before = residual(start)
    if not 2.0 * found.cost < float(before @ before):
        return tuple(terms)
    return tuple(_moved(terms, free, found.x))
