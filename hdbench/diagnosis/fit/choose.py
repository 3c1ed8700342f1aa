"""Names before tables: what has a name comes first where it explains as much."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.detect.looks import Look, look_at
from hdbench.diagnosis.fit.axes import axes_of
from hdbench.diagnosis.fit.jointfit import fit_jointly
from hdbench.diagnosis.fit.pairs import Pair, best_pairs
from hdbench.diagnosis.fit.terms import term_columns
from hdbench.diagnosis.naming.candidates import Candidate, refined_candidate
from hdbench.diagnosis.naming.curves import is_law
from hdbench.diagnosis.naming.nameless import unnamed
from hdbench.diagnosis.naming.ranking import RIVAL_NATS, promise, rank_looks
from hdbench.diagnosis.noise.whitened import Space, make_space
from hdbench.diagnosis.state import State

__all__ = ["named_first", "with_names"]

# a pair that is behind by more than this share of what it explains is not worth a fit of both: two
# shapes a tenth off each lose some fifth
_PAIR_LOSS = 0.25


def with_names(
    state: State,
    space: Space,
    looks: tuple[Look, ...],
    ranked: list[Candidate],
    least: float = -np.inf,
) -> list[Candidate]:
    """Return the candidates that have names, best first.

    Parameters
    ----------
    state : State
        Where the search stands.
    space : Space
        Residual that the looks belong to.
    looks : tuple of Look
        Looks that have terms.
    ranked : list of Candidate
        All candidates, best first.
    least : float
        Score that is of use, nats.

    Returns
    -------
    list of Candidate
        `ranked` itself where its first one has a name.
    """
    if not ranked or not unnamed(ranked[0].term):
        return ranked
    rest = tuple(k for k in looks if not all(map(unnamed, k.terms)))
    found = rank_looks(space, state.record, state.survey, rest, max(least, 0.0))
    return [c for c in found if not unnamed(c.term) and c.score_nats > 0.0]


def named_first(
    state: State,
    space: Space,
    looks: tuple[Look, ...],
    named: list[Candidate],
    ranked: list[Candidate],
) -> list[Candidate]:
    """Return the candidates with names where two of them explain as much as one without a name.

    A table or a bump gathers what two causes do at the same place, even where each of them hides
    most of the other. A law of one form gathers nothing: it stands against one name alone.

    Parameters
    ----------
    state : State
        Where the search stands.
    space : Space
        Residual that the looks belong to.
    looks : tuple of Look
        Looks that have terms.
    named : list of Candidate
        Candidates that have names, best first.
    ranked : list of Candidate
        All candidates, best first.

    Returns
    -------
    list of Candidate
    """
    if not unnamed(ranked[0].term) or not named:
        return ranked
    # a place without a name must explain more than one name or two by what makes a rival
    wanted = ranked[0].score_nats - RIVAL_NATS
    if named[0].score_nats < wanted:
        if is_law(ranked[0].term):
            return ranked
        columns = term_columns(named[0].term, state.record)
        explained = (*state.fit.parts, columns)
        beside = make_space(state.noise.whitener, explained, state.record.response_nm)
        terms = (*state.fit.terms, named[0].term)
        others, _ = look_at(beside, state.record, state.survey, terms, state.grams)
        second = max(
            (promise(k) for k in others.looks if k.terms and not all(map(unnamed, k.terms))),
            default=0.0,
        )
        if named[0].score_nats + max(second, 0.0) < wanted:
            pairs = best_pairs(space, state.record, looks, axes_of(ranked[0].term))
            if not pairs or _at_best(state, pairs[0], wanted) < wanted:
                return ranked
            first = refined_candidate(space, state.record, pairs[0].terms[0], 1.0)
            return [first, *(c for c in named if c.term.cause is not first.term.cause)]
    return [*named, *ranked]


def _at_best(state: State, pair: Pair, wanted: float) -> float:
    """Return the score of a pair, at the shapes that are best for both where that may be enough."""
    if pair.score_nats >= wanted or pair.score_nats + 0.5 * _PAIR_LOSS * pair.statistic < wanted:
        return pair.score_nats
    both = fit_jointly(state.record, (*state.fit.terms, *pair.terms), state.noise.whitener)
    return pair.score_nats + 0.5 * (state.fit.chi2 - both.chi2 - pair.statistic)
