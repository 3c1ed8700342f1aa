"""Causes that only change gains, told from gains that scatter from clamping to clamping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.fit import fit_loads
from hdbench.diagnosis.loads.names import Accepted, space_of
from hdbench.diagnosis.loads.scatter import GainScatter
from hdbench.diagnosis.loads.search import Found
from hdbench.diagnosis.loads.shapes import columns_of
from hdbench.diagnosis.loads.space import make_space, share_p_value
from hdbench.diagnosis.loads.table import LoadTable, base_columns, one_hot
from hdbench.model import Cause
from hdbench.records.trace import FloatArray

__all__ = ["name_between"]

# a scatter needs this many degrees of freedom of its own before anything is held against it
_LEAST_DOF = 2
_RANK = 1e-9


@dataclass(frozen=True, slots=True)
class _Test:
    """A cause held against the scatter of gains."""

    term: Term
    pattern: FloatArray
    p_value: float
    evidence_nats: float
    std: FloatArray


def _pattern(term: Term, table: LoadTable, scatter: GainScatter) -> FloatArray | None:
    """Return the gain that a term adds to each group, N m per N m; None where it adds more."""
    which = one_hot(scatter.groups)
    zeros = one_hot(table.experiment)
    design = np.hstack([table.torque_nm[:, None] * which, zeros])
    columns = columns_of(term, table)
    if not np.isfinite(columns).all():
        return None
    solution, _, _, _ = np.linalg.lstsq(design, columns, rcond=_RANK)
    left = columns - design @ solution
    if float(np.abs(left).max()) > _RANK**0.5 * float(np.abs(columns).max()):
        return None
    return np.asarray(solution[: which.shape[1]])


def _test(term: Term, table: LoadTable, scatter: GainScatter, values: FloatArray) -> _Test | None:
    """Hold a term against the scatter that stays, by an F test over groups or over positions."""
    pattern = _pattern(term, table, scatter)
    if pattern is None:
        return None
    groups = np.arange(len(values))
    place = np.array([table.place[scatter.groups == g][0] for g in groups])
    mean = one_hot(place) / one_hot(place).sum(axis=0)
    by_place = mean.T @ pattern
    if float(np.abs(pattern - by_place[np.unique(place, return_inverse=True)[1]]).max()) < _RANK:
        null, design, response = np.ones((len(by_place), 1)), by_place, mean.T @ values
    else:
        null, design, response = one_hot(place), pattern, values
    space = make_space(null, response, np.ones(len(response), dtype=bool))
    directions = space.directions(design)
    rank, rest = directions.shape[1], space.dof - directions.shape[1]
    if rank == 0 or rest < _LEAST_DOF:
        return None
    share = space.share(directions)
    left = space.basis.T @ design
    inverse = np.linalg.pinv(left.T @ left)
    variance = space.rss * (1.0 - share) / rest
    score = -0.5 * space.dof * np.log(max(1.0 - share, 1e-300)) - 0.5 * rank * np.log(len(response))
    chance = share_p_value(share, rank, space.dof)
    return _Test(term, pattern, chance, float(score), inverse * variance)


def name_between(
    found: Found, causes: Sequence[Cause], scatter: GainScatter, alpha: float
) -> tuple[Found, GainScatter, FloatArray]:
    """Name a cause whose gains stand above the scatter of all others.

    Parameters
    ----------
    found : Found
        What was found with a gain of its own for each group of the scatter.
    causes : sequence of Cause
        Causes that may be named; those without a shape that only change gains are tried.
    scatter : GainScatter
        Gains that scatter.
    alpha : float
        Probability of naming one by chance.

    Returns
    -------
    found : Found
        With the cause, where there is one.
    scatter : GainScatter
        What stays of the scatter.
    base : ndarray, shape (n, p)
        Columns of the baseline of that fit.

    Notes
    -----
    What is the same for all readings at a position is held against the scatter of the positions'
    mean gains, everything else against the scatter inside positions: the two strata of a split-plot
    design. The standard uncertainty is that scatter's.

    References
    ----------
    .. [1] S. R. Searle, G. Casella, C. E. McCulloch, Variance Components, Wiley 1992, chapter 4.
    """
    table = found.fit.table
    base = base_columns(table, scatter.groups)
    terms = [Term(cause, {}) for cause in causes if not cause.shape]
    tests = [t for term in terms if (t := _test(term, table, scatter, scatter.deviation))]
    if not tests:
        return found, scatter, base
    best = min(tests, key=lambda t: t.p_value)
    chance = min(1.0, len(tests) * best.p_value)
    if not (chance < alpha and best.evidence_nats > 0.0):
        return found, scatter, base
    base, still = _around(best, table, scatter)
    fit = fit_loads(table, base, (*found.fit.terms, best.term))
    fit = replace(fit, covariances=(*fit.covariances[:-1], best.std))
    group = [t.term for t in tests if _alike(t, best)]
    group.sort(key=lambda term: term is not best.term)
    place = len(fit.terms) - 1
    accepted = Accepted(fit.terms[-1], chance, best.evidence_nats, tuple(group), (), (place,))
    space = space_of(fit)
    return replace(found, fit=fit, space=space, accepted=(*found.accepted, accepted)), still, base


def _alike(test: _Test, best: _Test) -> bool:
    """Return whether two causes have the same pattern of gains."""
    both = np.hstack([test.pattern, best.pattern])
    rank = np.linalg.matrix_rank(both / np.abs(both).max(axis=0), tol=_RANK**0.5)
    return bool(rank == np.linalg.matrix_rank(best.pattern) == np.linalg.matrix_rank(test.pattern))


def _around(test: _Test, table: LoadTable, scatter: GainScatter) -> tuple[FloatArray, GainScatter]:
    """Return a baseline whose free gains leave the pattern of a cause alone, and the rest."""
    count = len(scatter.deviation)
    fixed = np.hstack([np.ones((count, 1)), test.pattern])
    u, s, _ = np.linalg.svd(fixed, full_matrices=True)
    free = u[:, int((s > _RANK * s[0]).sum()) :]
    columns = table.torque_nm[:, None] * (one_hot(scatter.groups) @ free)
    rest = free @ (free.T @ scatter.deviation)
    return np.hstack([base_columns(table), columns]), replace(scatter, deviation=rest)
