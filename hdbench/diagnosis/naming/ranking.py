"""Which names explain a residual, best first; which of them the record cannot tell apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.detect.looks import Look
from hdbench.diagnosis.detect.survey import Survey
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.candidates import (
    Candidate,
    imitated,
    refined_candidate,
    same_space,
    whole_order,
)
from hdbench.diagnosis.naming.evidence import most_evidence
from hdbench.diagnosis.naming.nameless import unnamed
from hdbench.diagnosis.noise.whitened import Space

__all__ = ["RIVAL_NATS", "Naming", "name_residual", "promise", "rank_looks"]

# names within this many nats of the best are rivals: a Bayes factor of 20
RIVAL_NATS = 3.0
# the grid of shapes loses a tenth of the statistic at most, neighbours having 0.9 in common
_GRID_LOSS = 0.12
# candidates refined at most, most promising first
_MAX_CANDIDATES = 14
# a name whose statistic is this share of the best one's may span the same space
_TWIN = 0.97


@dataclass(frozen=True, slots=True)
class Naming:
    """The best name and what it could also be.

    Parameters
    ----------
    best : Candidate
        Best candidate.
    group : tuple of Term
        Terms that span the same space on this record, the best first.
    rivals : tuple of Term
        Other terms within 3 nats.
    probability : float
        Share of the group in the evidence of all names, each as likely as any other beforehand.
    """

    best: Candidate
    group: tuple[Term, ...]
    rivals: tuple[Term, ...]
    probability: float


def promise(look: Look) -> float:
    """Return the most that a look can score after its shape was refined.

    Parameters
    ----------
    look : Look
        Look.

    Returns
    -------
    float
        Score, nats.
    """
    loss = _GRID_LOSS if any(term.shape for term in look.terms) else 0.0
    reach = look.statistic * (1.0 + loss)
    return max(
        (most_evidence(term, reach, look.dof, look.trials) for term in look.terms), default=-np.inf
    )


def _known_trials(survey: Survey, statistic: float) -> float:
    """Return the effective number of known orders."""
    return max(
        (k.law.trials(statistic) for k in survey.known if k.name == "known orders"), default=1.0
    )


def rank_looks(
    space: Space,
    record: Record,
    survey: Survey,
    looks: tuple[Look, ...],
    least: float = -np.inf,
) -> list[Candidate]:
    """Refine the most promising looks, best score first.

    Parameters
    ----------
    space : Space
        Whitened residual.
    record : Record
        Record.
    survey : Survey
        Plan of the looks.
    looks : tuple of Look
        Looks that have terms.
    least : float
        Score that is of use, nats.

    Returns
    -------
    list of Candidate
        Those within 3 nats of the best, those that may span its space, and what else was
        refined on the way. Among equal scores the name with fewer free shapes comes first.
    """
    order = sorted((look for look in looks if look.terms), key=promise, reverse=True)
    done: list[Candidate] = []
    best, top = -np.inf, 0.0
    for look in order[:_MAX_CANDIDATES]:
        reach = look.statistic * (1.0 + _GRID_LOSS)
        hopeful = promise(look)
        if hopeful < least or (hopeful < best - RIVAL_NATS and reach < _TWIN * top):
            continue
        for term in look.terms:
            wanted = max(
                _needed(look, term, least),
                min(_needed(look, term, best - RIVAL_NATS), _TWIN * top),
            )
            found = refined_candidate(space, record, term, look.trials, wanted)
            found = whole_order(space, record, found, _known_trials(survey, found.statistic))
            done.append(found)
            best, top = max(best, found.score_nats), max(top, found.statistic)
    done = [c for c in done if np.isfinite(c.score_nats)]
    done = sorted(done, key=lambda c: (-round(c.score_nats, 6), len(c.term.cause.shape)))
    return _simpler_first(space, record, done)


def _needed(look: Look, term: Term, score_nats: float) -> float:
    """Return the statistic below which a term of a look cannot have a score."""
    return 2.0 * (score_nats - most_evidence(term, 0.0, look.dof, look.trials))


def _simpler_first(space: Space, record: Record, ranked: list[Candidate]) -> list[Candidate]:
    """Return candidates with a simpler name at the head where the best one hardly adds to it.

    A resonance far from where the record runs is a line of constant amplitude, at other places any
    slope of one: what a name with more free shapes gains by a like effect within 3 nats is no
    evidence for it. Only names that explain the same head each other so; the more general one
    stays a rival.
    """
    if not ranked or unnamed(ranked[0].term):
        return ranked
    best = ranked[0]
    for other in ranked[1:]:
        if best.score_nats - other.score_nats > RIVAL_NATS or unnamed(other.term):
            continue
        fewer = len(other.term.cause.shape) < len(best.term.cause.shape)
        if fewer and other.dof <= best.dof and imitated(space, record, best.term, other.term):
            return [other, *(c for c in ranked if c is not other)]
    return ranked


def name_residual(space: Space, record: Record, ranked: list[Candidate]) -> Naming:
    """Return the best name with its group and its rivals.

    Parameters
    ----------
    space : Space
        Whitened residual.
    record : Record
        Record.
    ranked : list of Candidate
        Candidates, best first; at least one.

    Returns
    -------
    Naming
    """
    best = ranked[0]
    group: list[Term] = [best.term]
    rivals: list[Term] = []
    for other in ranked[1:]:
        names = {term.cause.name for term in (*group, *rivals)}
        if unnamed(other.term) or other.term.cause.name in names:
            continue
        alike = other.statistic >= _TWIN * best.statistic
        if alike and same_space(space, record, best.term, other.term):
            group.append(other.term)
        elif best.score_nats - other.score_nats <= RIVAL_NATS:
            rivals.append(other.term)
    return Naming(best, tuple(group), tuple(rivals), _probability(ranked, group))


def _probability(ranked: list[Candidate], group: list[Term]) -> float:
    """Return the share of a group of names in the evidence of all names."""
    own = {term.cause.name for term in group}
    nats: dict[str, float] = {}
    for one in ranked:
        name = one.term.cause.name
        if name in own or not unnamed(one.term):
            nats[name] = max(one.score_nats, nats.get(name, -np.inf))
    top = max(nats.values())
    shares = {name: float(np.exp(value - top)) for name, value in nats.items()}
    # in the order of the names' evidence: a set has another order in every process
    return sum(share for name, share in shares.items() if name in own) / sum(shares.values())
