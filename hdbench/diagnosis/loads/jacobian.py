"""Slopes of readings over every parameter of a fit, and what is known of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.shapes import DISCRETE, HELD, columns_of
from hdbench.diagnosis.loads.table import LoadTable
from hdbench.model import Parameter
from hdbench.records.trace import FloatArray

__all__ = ["Jacobian", "jacobian_of", "term_covariances"]

# relative change of a shape parameter by which its slope is formed
_STEP = 1e-4
# directions whose share of the scaled columns falls below this cannot be resolved
_RANK = 1e-9


@dataclass(frozen=True, slots=True)
class Jacobian:
    """Slopes of the readings.

    Parameters
    ----------
    columns : ndarray, shape (n, k)
        V per unit of: slope, other coefficients of the baseline, then of each term the linear
        parameters and the shapes that have a slope.
    places : tuple of tuple of int
        Column of each term's linear, then shape parameters; -1 for a shape without a slope.
    """

    columns: FloatArray
    places: tuple[tuple[int, ...], ...]


def jacobian_of(
    base: FloatArray,
    terms: Sequence[Term],
    linear: Sequence[FloatArray],
    slope: float,
    table: LoadTable,
) -> Jacobian:
    """Return the slopes of ``slope * (torque + effects) + zeros`` over every parameter.

    Parameters
    ----------
    base : ndarray, shape (n, p)
        Columns of the baseline, the applied torque first.
    terms : sequence of Term
        Terms.
    linear : sequence of ndarray
        Their linear parameters.
    slope : float
        V/(N m).
    table : LoadTable
        Readings.

    Returns
    -------
    Jacobian
    """
    parts = [base.copy()]
    places: list[tuple[int, ...]] = []
    width = base.shape[1]
    for term, a in zip(terms, linear, strict=True):
        block = columns_of(term, table)
        parts[0][:, 0] += block @ a
        columns = [slope * block]
        mine = list(range(width, width + len(a)))
        width += len(a)
        for parameter in term.cause.shape:
            change = _shape_slope(term, parameter, a, table)
            mine.append(-1 if change is None else width)
            if change is not None:
                columns.append(slope * change[:, None])
                width += 1
        parts += columns
        places.append(tuple(mine))
    return Jacobian(np.hstack(parts), tuple(places))


def _shape_slope(
    term: Term, parameter: Parameter, linear: FloatArray, table: LoadTable
) -> FloatArray | None:
    """Return d(torque)/d(shape), N m per unit; None where it has none or is held."""
    name = parameter.name
    if name in (*DISCRETE, *HELD):
        return None
    value = term.shape[name]
    step = _STEP * max(abs(value), 1e-6)
    ends = []
    for trial in (value - step, value + step):
        inside = trial if parameter.contains(trial) else value
        moved = replace(term, shape={**term.shape, name: inside})
        ends.append((inside, columns_of(moved, table) @ linear))
    (low, before), (high, after) = ends
    if not high > low:
        return None
    slope = (after - before) / (high - low)
    return np.asarray(slope) if bool(np.any(slope != 0.0)) else None


def term_covariances(
    jacobian: Jacobian, terms: Sequence[Term], table: LoadTable, left_v: FloatArray
) -> tuple[tuple[FloatArray, ...], int]:
    """Return the covariance of each term's parameters and the degrees of freedom.

    Parameters
    ----------
    jacobian : Jacobian
        Slopes.
    terms : sequence of Term
        Terms.
    table : LoadTable
        Readings.
    left_v : ndarray, shape (n_used,)
        Residual, V.

    Returns
    -------
    covariances : tuple of ndarray
        Of the linear, then the shape parameters; zero for shapes without a slope and for those that
        are known no better than their domain.
    dof : int
        Readings less resolved parameters.
    """
    columns = jacobian.columns[table.used]
    size = np.sqrt(np.einsum("nk,nk->k", columns, columns))
    size = np.where(size > 0.0, size, 1.0)
    scaled = columns / size
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    good = values > _RANK * values[-1]
    dof = len(columns) - int(good.sum())
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(size, size)
    covariance = inverse * float(left_v @ left_v) / max(dof, 1)
    blocks = []
    for mine, term in zip(jacobian.places, terms, strict=True):
        known = [i for i, place in enumerate(mine) if place >= 0]
        index = [mine[i] for i in known]
        block = np.zeros((len(mine), len(mine)))
        block[np.ix_(known, known)] = covariance[np.ix_(index, index)]
        blocks.append(_resolved(block, term))
    return tuple(blocks), dof


def _resolved(block: FloatArray, term: Term) -> FloatArray:
    """Return a covariance with zeros for shapes that are known no better than their domain."""
    n = len(term.cause.linear)
    for index, parameter in enumerate(term.cause.shape):
        bands = parameter.bands or ((parameter.lower, parameter.upper),)
        width = max(high for _, high in bands) - min(low for low, _ in bands)
        if not block[n + index, n + index] < width**2:
            block[n + index, :] = block[:, n + index] = 0.0
    return block
