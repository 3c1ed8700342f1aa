"""Gain, zeros and causes fitted together, shape parameters too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.jacobian import jacobian_of, term_covariances
from hdbench.diagnosis.loads.refine import design_matrix, refined_terms, scaled_solve
from hdbench.diagnosis.loads.shapes import columns_of, with_simulated
from hdbench.diagnosis.loads.table import LoadTable
from hdbench.records.trace import FloatArray

__all__ = ["LoadFit", "fit_loads", "score_nats"]

# readings carry rounding at this share of the largest one: a sum of squares below is none
_ROUNDING = 1e-12
# the gain must stand this far above rounding to divide by it
_LEAST_GAIN = 1e-12


@dataclass(frozen=True, slots=True)
class LoadFit:
    """Result of a joint fit.

    Parameters
    ----------
    terms : tuple of Term
        Causes with refined shapes.
    slope_v_per_nm : float
        Reading per torque, V/(N m): one over the gain.
    base : ndarray, shape (p,)
        Coefficients of the baseline's columns, V per unit.
    linear : tuple of ndarray
        Linear parameters of each term, in its own units.
    covariances : tuple of ndarray
        Covariance of each term's linear, then shape parameters; shape rows are zero where a shape
        has no slope.
    fitted_v : ndarray, shape (n,)
        Fitted readings, V.
    explained : ndarray, shape (n, m)
        Columns that span the fit, slopes over the shapes among them.
    rss : float
        Sum of squares of the residual, V^2.
    dof : int
        Readings less resolved parameters.
    table : LoadTable
        The readings with the torque of this fit, before any limit.
    """

    terms: tuple[Term, ...]
    slope_v_per_nm: float
    base: FloatArray
    linear: tuple[FloatArray, ...]
    covariances: tuple[FloatArray, ...]
    fitted_v: FloatArray
    explained: FloatArray
    rss: float
    dof: int
    table: LoadTable


def fit_loads(
    table: LoadTable, base: FloatArray, terms: Sequence[Term], *, refine: bool = True
) -> LoadFit:
    r"""Fit gain, zeros and causes together.

    Parameters
    ----------
    table : LoadTable
        Readings.
    base : ndarray, shape (n, p)
        Columns of the baseline, the applied torque first.
    terms : sequence of Term
        Causes with starting shapes.
    refine : bool
        Refine the shapes too.

    Returns
    -------
    LoadFit

    Notes
    -----
    .. math:: V_n = S (\tau_n + z_{e(n)} + \sum_j X_j(q_j) a_j) + \epsilon_n

    by least squares of readings on torque, because the weights are known and the readings are
    noisy; S is one over the gain. Shapes by variable projection. The covariance is that of
    (S, z, a, q) together, times the mean square of the residual.
    """
    chosen = refined_terms(terms, base, table) if refine else tuple(terms)
    used = table.used
    design = design_matrix(base, chosen, table)
    solution = scaled_solve(design[used], table.reading_v[used])
    slope = float(solution[0])
    slope = slope if abs(slope) > _LEAST_GAIN else _LEAST_GAIN
    sizes = np.cumsum([base.shape[1], *(len(t.cause.linear) for t in chosen)])
    linear = [part / slope for part in np.split(solution, sizes)[1 : 1 + len(chosen)]]
    fitted = design @ solution
    left = (table.reading_v - fitted)[used]
    jacobian = jacobian_of(base, chosen, linear, slope, table)
    covariances, dof = term_covariances(jacobian, chosen, table, left)
    floor = int(used.sum()) * (_ROUNDING * float(np.abs(table.reading_v[used]).max())) ** 2
    return LoadFit(
        chosen,
        slope,
        solution[: base.shape[1]],
        tuple(linear),
        covariances,
        fitted,
        jacobian.columns,
        max(float(left @ left), floor),
        dof,
        with_simulated(table, fitted / slope - _taken(chosen, linear, table)),
    )


def _taken(terms: Sequence[Term], linear: Sequence[FloatArray], table: LoadTable) -> FloatArray:
    """Return what limits take from the whole signal, N m: they act on it as it is before."""
    taken = np.zeros(len(table))
    for term, a in zip(terms, linear, strict=True):
        if "limit_nm" in term.shape:
            taken += columns_of(term, table) @ a
    return taken


def score_nats(before: LoadFit, after: LoadFit, added: int) -> float:
    """Return the evidence for a fit with more parameters.

    Parameters
    ----------
    before, after : LoadFit
        Fits without and with them.
    added : int
        Parameters added.

    Returns
    -------
    float
        ``(dof / 2) ln(rss_before / rss_after) - (added / 2) ln n``, nats, dof of `before`.
    """
    n = float(after.table.used.sum())
    return 0.5 * before.dof * float(np.log(before.rss / after.rss)) - 0.5 * added * float(np.log(n))
