"""The names that an accepted term could also have."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.bentarm import BENT_LIKE, bent_arm
from hdbench.diagnosis.loads.families import Family
from hdbench.diagnosis.loads.fit import LoadFit, fit_loads, score_nats
from hdbench.diagnosis.loads.pace import MEMORY, memory_share
from hdbench.diagnosis.loads.shapes import DISCRETE, HELD, columns_of
from hdbench.diagnosis.loads.space import Space, make_space
from hdbench.diagnosis.loads.table import LoadTable
from hdbench.diagnosis.loads.trial import trial_fit
from hdbench.records.trace import FloatArray

__all__ = [
    "RIVAL_NATS",
    "Accepted",
    "accept",
    "is_outlier",
    "parameters_of",
    "same_space",
    "space_of",
    "without",
]

# names within this many nats of the best are rivals: a Bayes factor of 20
RIVAL_NATS = 3.0
# ... and a name that explains this share of what the best one explains is its rival, however small
# the noise: the difference is one of form. A loop from rest on equal steps is nearly a creep.
_LIKE = 0.99
# odds that are beyond all doubt
_MOST_NATS = 100.0
# contract: names whose effect spans the same space on this record
_SAME_SPACE = 0.01


@dataclass(frozen=True, slots=True)
class Accepted:
    """An accepted term and what it could also be.

    Parameters
    ----------
    term : Term
        The term as fitted.
    false_alarm : float
        Probability of such a finding on these readings without any effect.
    evidence_nats : float
        Score against the fit without it.
    group : tuple of Term
        Terms that span the same space on these readings, the accepted one first.
    rivals : tuple of Term
        Other terms within 3 nats, or that explain 99 % of what the accepted one explains.
    places : tuple of int
        Indices of its elements in the final fit: one, more where its form takes several.
    alone : LoadFit or None
        Fit with its first element alone, last among the terms, where it has several.
    probability : float or None
        Of the group, among all names, each as likely as any other beforehand.
    made_of : tuple of Term
        What is to stand in its place in the fit, where that is not the term that is there.
    """

    term: Term
    false_alarm: float
    evidence_nats: float
    group: tuple[Term, ...]
    rivals: tuple[Term, ...]
    places: tuple[int, ...]
    alone: LoadFit | None = None
    probability: float | None = None
    made_of: tuple[Term, ...] = ()


def is_outlier(term: Term) -> bool:
    """Return whether a term is a reading that stands apart and no cause with a name.

    Parameters
    ----------
    term : Term
        Term.

    Returns
    -------
    bool
    """
    return term.cause.name == "outlier"


def parameters_of(term: Term, less: LoadFit, more: LoadFit) -> int:
    """Return how many parameters a score pays for a term, between fits without and with it.

    Columns that the design cannot tell apart cost one parameter; shapes without a slope, such as
    the time of a step, cost one each.

    Parameters
    ----------
    term : Term
        The term.
    less, more : LoadFit
        Fits without and with it.

    Returns
    -------
    int
    """
    discrete = sum(p.name in DISCRETE for p in term.cause.shape)
    return less.dof - more.dof + discrete


def space_of(fit: LoadFit) -> Space:
    """Return what a fit leaves of the readings.

    Parameters
    ----------
    fit : LoadFit
        Fit.

    Returns
    -------
    Space
    """
    return make_space(fit.explained, fit.table.reading_v, fit.table.used)


def same_space(space: Space, table: LoadTable, first: Term, second: Term) -> bool:
    """Return whether two terms span the same space on these readings.

    Parameters
    ----------
    space : Space
        Complement of what both have in common to explain.
    table : LoadTable
        Readings.
    first, second : Term
        Terms.

    Returns
    -------
    bool
        True where both have as many directions and the sine squared of the largest angle between
        them is below 0.01.
    """
    a, b = (space.directions(columns_of(term, table)) for term in (first, second))
    if a.shape[1] != b.shape[1] or a.shape[1] == 0:
        return False
    return space.sine_squared(a, b) < _SAME_SPACE


def without(terms: tuple[Term, ...], place: int) -> tuple[Term, ...]:
    """Return the terms but for one.

    Parameters
    ----------
    terms : tuple of Term
        Terms.
    place : int
        Index of the one that is left out.

    Returns
    -------
    tuple of Term
    """
    return terms[:place] + terms[place + 1 :]


def _holds(family: Family, space: Space, table: LoadTable, term: Term) -> bool:
    """Return whether a member of a family spans the same space as a term."""
    mine = space.directions(columns_of(term, table))
    alike = [c.directions for c in family.cells if c.directions.shape[1] == mine.shape[1] > 0]
    return any(space.sine_squared(mine, other) < _SAME_SPACE for other in alike)


def accept(
    fit: LoadFit,
    place: int,
    base: FloatArray,
    families: Callable[[LoadFit, Space], Sequence[Family]],
    false_alarm: float,
) -> Accepted:
    """Return a term of the final fit with the names that it could also have.

    Parameters
    ----------
    fit : LoadFit
        Final fit.
    place : int
        Index of the term.
    base : ndarray, shape (n, p)
        Columns of the baseline.
    families : callable
        ``families(fit, space)`` gives the families that the residual of a fit could show.
    false_alarm : float
        Probability of the finding.

    Returns
    -------
    Accepted
    """
    term, table = fit.terms[place], fit.table
    less = fit_loads(table, base, without(fit.terms, place), refine=False)
    mine = score_nats(less, fit, parameters_of(term, less, fit))
    space = space_of(less)
    group, rivals = [term], []
    others: dict[str, float] = {}
    made = [] if is_outlier(term) else families(less, space)
    memory = memory_share(table)
    for family in made:
        if family.name in (term.cause.name, "outlier"):
            continue
        trial = trial_fit(family, less, base, space)
        if trial is None:
            continue
        other = trial.terms[-1]
        held = any(p.name in HELD for p in other.cause.shape)
        alike = same_space(space, table, term, other)
        if alike or (not held and _holds(family, space, table, term)):
            group.append(other)
            continue
        score = score_nats(less, trial, parameters_of(other, less, trial))
        share = memory if {term.cause.name, other.cause.name} == MEMORY else _LIKE
        like = less.rss - trial.rss >= share * (less.rss - fit.rss)
        # what differs in form alone is never less likely than a rival is, whatever the noise says
        others[family.name] = max(score, mine - RIVAL_NATS) if like else score
        if mine - score <= RIVAL_NATS or like:
            rivals.append(other)
    bent = bent_arm(less, made, base) if term.cause.name in BENT_LIKE else None
    if bent is not None and bent.score_nats - mine > RIVAL_NATS:
        beside = {**others, term.cause.name: mine}
        near = [t for t in (term, *rivals) if t.cause.name != bent.name]
        near = [t for t in near if bent.score_nats - beside[t.cause.name] <= RIVAL_NATS]
        share = _share(bent.score_nats, (v for name, v in beside.items() if name != bent.name))
        parts = (bent.terms[0], false_alarm, bent.score_nats, bent.terms[:1], tuple(near), (place,))
        return Accepted(*parts, probability=share, made_of=bent.terms)
    if bent is not None and bent.score_nats >= mine:
        rivals += [bent.terms[0]] if bent.name not in {r.cause.name for r in rivals} else []
        others[bent.name] = max(others.get(bent.name, -np.inf), bent.score_nats)
    probability = None if is_outlier(term) else _share(mine, others.values())
    names = (tuple(group), tuple(rivals), (place,))
    return Accepted(term, false_alarm, mine, *names, probability=probability)


def _share(mine: float, others: Iterable[float]) -> float:
    """Return the share of one evidence among others."""
    return float(1.0 / (1.0 + sum(np.exp(min(value - mine, _MOST_NATS)) for value in others)))
