"""Candidates for a name: refined, scored, and held against each other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.detect.exact import exact_statistic
from hdbench.diagnosis.fit.families import refine_term
from hdbench.diagnosis.fit.terms import Term, term_columns
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.evidence import evidence, score
from hdbench.diagnosis.noise.whitened import Space

__all__ = ["Candidate", "imitated", "refined_candidate", "same_space", "whole_order"]

# contract: names whose effect spans the same space on this record
_SAME_SPACE = 0.01
_RANK = 1e-9
# columns of a line, and odds of 20 to 1 against one at an order that is not whole
_LINE = 2
_BROKEN_ORDER_NATS = 3.0


@dataclass(frozen=True, slots=True)
class Candidate:
    """A term that may be accepted, at its best shape.

    Parameters
    ----------
    term : Term
        Refined term.
    statistic : float
        Fall of the whitened sum of squares that it brings.
    dof : int
        Linear parameters that the record can tell.
    score_nats : float
        As `evidence` gives it.
    """

    term: Term
    statistic: float
    dof: int
    score_nats: float


def refined_candidate(
    space: Space, record: Record, term: Term, trials: float, wanted: float = -np.inf
) -> Candidate:
    """Move a term to its best shape and score it.

    Parameters
    ----------
    space : Space
        Whitened residual without the term.
    record : Record
        Record.
    term : Term
        Term with a starting shape.
    trials : float
        Effective number of shapes that were tried.
    wanted : float
        Statistic that is of use.

    Returns
    -------
    Candidate
        With a score of minus infinity where it will not come near what is wanted.
    """
    best = refine_term(space, record, term, wanted)
    # what the catalogue calls impossible explains nothing
    value = evidence(space, record, best, trials) if best.within else -np.inf
    return Candidate(best.term, best.statistic, best.dof, value)


def whole_order(space: Space, record: Record, candidate: Candidate, trials: float) -> Candidate:
    """Return a line at the next whole order where that explains it as well.

    Lobes, teeth and poles repeat a whole number of times per turn, rolling elements do not: a
    single harmonic of any other order is less likely beforehand than a bearing's line there.

    Parameters
    ----------
    space : Space
        Whitened residual without the term.
    record : Record
        Record.
    candidate : Candidate
        Candidate.
    trials : float
        Effective number of known orders.

    Returns
    -------
    Candidate
        The one with the better score.
    """
    term = candidate.term
    if [*term.shape] != ["order"] or term.cause.locked_to != "motor":
        return candidate
    single = len(term.cause.linear) == _LINE
    best = replace(candidate, score_nats=candidate.score_nats - single * _BROKEN_ORDER_NATS)
    for factor in {1.0, record.motion.gauge_factor}:
        order = float(round(term.shape["order"] / factor)) * factor
        if not term.cause.shape[0].contains(order):
            continue
        held = Term(term.cause, {"order": order})
        statistic, dof, _ = exact_statistic(space, term_columns(held, record))
        value = score(statistic, dof, trials)
        if value > best.score_nats:
            best = Candidate(held, statistic, dof, value)
    return best


def imitated(space: Space, record: Record, first: Term, second: Term) -> bool:
    """Return whether the second term gives the torque that the first one fits.

    Parameters
    ----------
    space : Space
        Whitened residual.
    record : Record
        Record.
    first, second : Term
        Terms.

    Returns
    -------
    bool
        True where less than 0.01 of the first one's whitened torque is left beside the second.
    """
    columns = term_columns(first, record)
    torque = space.project(columns @ exact_statistic(space, columns)[2])
    other = space.project(term_columns(second, record))
    left = torque - other @ np.linalg.lstsq(other.T @ other, other.T @ torque, rcond=_RANK)[0]
    return bool(float(left @ left) < _SAME_SPACE * float(torque @ torque))


def same_space(space: Space, record: Record, first: Term, second: Term) -> bool:
    """Return whether two terms span the same space on this record.

    Parameters
    ----------
    space : Space
        Whitened space with what both have in common to explain projected out.
    record : Record
        Record.
    first, second : Term
        Terms.

    Returns
    -------
    bool
        True where both have as many directions and the sine squared of the largest angle
        between them is below 0.01.
    """
    bases = []
    for term in (first, second):
        left = space.project(term_columns(term, record))
        values, vectors = np.linalg.eigh(left.T @ left)
        good = values > _RANK * max(float(values[-1]), 1e-300)
        bases.append(left @ (vectors[:, good] / np.sqrt(values[good])))
    if bases[0].shape[1] != bases[1].shape[1]:
        return False
    cosines = np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)
    return bool(1.0 - float(cosines.min()) ** 2 < _SAME_SPACE)
