"""The names that an accepted term could also have."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.loads.bentarm import BENT_LIKE, BentArm, bent_arm
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
    term = fit.terms[place]
    less = fit_loads(fit.table, base, without(fit.terms, place), refine=False)
    space = space_of(less)
    made = [] if is_outlier(term) else families(less, space)
    beside = _Beside(score_nats(less, fit, parameters_of(term, less, fit)), [term], [], {})
    for family in made:
        if family.name in (term.cause.name, "outlier"):
            continue
        trial = trial_fit(family, less, base, space)
        if trial is not None:
            beside.take(family, trial, less, fit, space)
    bent = bent_arm(less, made, base) if term.cause.name in BENT_LIKE else None
    if bent is not None and bent.score_nats - beside.mine > RIVAL_NATS:
        return _as_bent(beside, bent, place, false_alarm)
    if bent is not None and bent.score_nats >= beside.mine:
        if bent.name not in {rival.cause.name for rival in beside.rivals}:
            beside.rivals.append(bent.terms[0])
        beside.others[bent.name] = max(beside.others.get(bent.name, -np.inf), bent.score_nats)
    names = (tuple(beside.group), tuple(beside.rivals), (place,))
    probability = None if is_outlier(term) else _share(beside.mine, beside.others.values())
    return Accepted(term, false_alarm, beside.mine, *names, probability=probability)


@dataclass(slots=True)
class _Beside:
    """A term and the names that are held against it.

    Parameters
    ----------
    mine : float
        Score of the term, nats.
    group, rivals : list of Term
        Names that nothing tells from it, the term first; names within 3 nats.
    others : dict of str to float
        Scores of all that were held against it, nats.
    """

    mine: float
    group: list[Term]
    rivals: list[Term]
    others: dict[str, float]

    def take(
        self, family: Family, trial: LoadFit, less: LoadFit, fit: LoadFit, space: Space
    ) -> None:
        """Hold a family against the term: in its group, a rival, or neither."""
        term, other, table = self.group[0], trial.terms[-1], fit.table
        held = any(p.name in HELD for p in other.cause.shape)
        alike = same_space(space, table, term, other)
        if alike or (not held and _holds(family, space, table, term)):
            self.group.append(other)
            return
        score = score_nats(less, trial, parameters_of(other, less, trial))
        share = memory_share(table) if {term.cause.name, other.cause.name} == MEMORY else _LIKE
        like = less.rss - trial.rss >= share * (less.rss - fit.rss)
        # what differs in form alone is never less likely than a rival is, whatever the noise says
        self.others[family.name] = max(score, self.mine - RIVAL_NATS) if like else score
        if self.mine - score <= RIVAL_NATS or like:
            self.rivals.append(other)


def _as_bent(beside: _Beside, bent: BentArm, place: int, false_alarm: float) -> Accepted:
    """Return an arm that bends far as the name of a term that it looks like."""
    scores = {**beside.others, beside.group[0].cause.name: beside.mine}
    near = [t for t in (beside.group[0], *beside.rivals) if t.cause.name != bent.name]
    near = [t for t in near if bent.score_nats - scores[t.cause.name] <= RIVAL_NATS]
    share = _share(bent.score_nats, (v for name, v in scores.items() if name != bent.name))
    parts = (bent.terms[0], false_alarm, bent.score_nats, bent.terms[:1], tuple(near), (place,))
    return Accepted(*parts, probability=share, made_of=bent.terms)


def _share(mine: float, others: Iterable[float]) -> float:
    """Return the share of one evidence among others."""
    return float(1.0 / (1.0 + sum(np.exp(min(value - mine, _MOST_NATS)) for value in others)))
