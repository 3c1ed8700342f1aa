"""Drop and swap: what was accepted is gone over again beside all the rest."""

from __future__ import annotations

from dataclasses import replace

from hdbench.diagnosis.detect.looks import look_at
from hdbench.diagnosis.fit.formterms import beyond_form
from hdbench.diagnosis.fit.jointfit import JointFit, fit_jointly
from hdbench.diagnosis.naming.candidates import Candidate
from hdbench.diagnosis.naming.evidence import score
from hdbench.diagnosis.naming.nameless import unnamed
from hdbench.diagnosis.naming.ranking import RIVAL_NATS, name_residual, rank_looks
from hdbench.diagnosis.noise.whitened import make_space
from hdbench.diagnosis.state import State, accepted_as

__all__ = ["drop_needless", "rename_all", "strengths", "take_out"]

# rounds in which the names of several causes are gone over again
_SWEEPS = 2
# more causes than these are gone over once: a round costs a search
_FEW = 4
# a name replaces another where its score is better by this, nats
_BETTER = 0.5
# beside a cause that explains a hundred times as much, a later one may be what that one's form
# leaves: it takes no part in its name
_PEER = 0.01


def drop_needless(state: State) -> bool:
    """Take out a cause that a later one has made needless.

    Parameters
    ----------
    state : State
        Where the search stands; changed.

    Returns
    -------
    bool
        True where one was taken out.
    """
    n_known = state.n_known
    for index in range(_evident(state), len(state.accepted) - 1):
        if _formed(state, index):
            continue
        place = n_known + index
        term = state.fit.terms[place]
        paid = len(term.cause.linear) + len(term.cause.shape)
        if score(state.fit.loss(place), paid, 1.0) < 0.0:
            take_out(state, index)
            return True
    return False


def take_out(state: State, index: int) -> None:
    """Take one accepted cause out, and fit the others anew.

    Parameters
    ----------
    state : State
        Where the search stands; changed.
    index : int
        Index among the accepted causes.
    """
    place = state.n_known + index
    del state.accepted[index]
    state.settle(state.fit.terms[:place] + state.fit.terms[place + 1 :])


def _evident(state: State) -> int:
    """Return how many accepted causes come first that need no test: an arm's weight.

    A noise with a long memory can take the place of anything slow, whatever its size.
    """
    return 1 if state.record.weighty and state.accepted else 0


def rename_all(state: State) -> None:
    """Name each accepted cause again beside all the others, and keep the better name.

    What has hardly any evidence left beside better names goes.

    Parameters
    ----------
    state : State
        Where the search stands; changed.
    """
    for _ in range(_SWEEPS if len(state.accepted) <= _FEW else 1):
        changed = False
        for index in range(_evident(state), len(state.accepted)):
            losses = strengths(state.fit)[state.n_known :]
            peers = [
                state.n_known + other
                for other, loss in enumerate(losses)
                if other != index and loss >= _PEER * losses[index]
            ]
            if peers and not _formed(state, index):
                changed |= _rename_one(state, index, peers)
        if not changed:
            break
    _drop_unsure(state)


def _drop_unsure(state: State) -> None:
    """Take out causes that no longer are twenty times as likely as none."""
    for index in reversed(range(_evident(state), len(state.accepted))):
        unsure = state.accepted[index].evidence_nats < RIVAL_NATS
        if unsure and len(state.accepted) > 1 and not _formed(state, index):
            take_out(state, index)


def _formed(state: State, index: int) -> bool:
    """Return whether a cause is so strong that its form was extended, or is such an extension."""
    name = state.accepted[index].name
    return any(one.form and one.name == name for one in state.accepted)


def strengths(fit: JointFit) -> list[float]:
    """Return what the loss of each term would cost.

    Parameters
    ----------
    fit : JointFit
        Joint fit.

    Returns
    -------
    list of float
        Rise of the whitened sum of squares, the other shapes as they are.
    """
    return [fit.loss(k) for k in range(len(fit.terms))]


def _names_first(ranked: list[Candidate]) -> list[Candidate]:
    """Return candidates with a name at the head where none without one explains clearly more."""
    named = [c for c in ranked if not unnamed(c.term)]
    if not named or named[0].score_nats < ranked[0].score_nats - RIVAL_NATS:
        return ranked
    return [*named, *(c for c in ranked if unnamed(c.term))]


def _rename_one(state: State, index: int, peers: list[int]) -> bool:
    """Name one accepted cause again beside its peers; True where its name changed."""
    record, terms = state.record, state.fit.terms
    place = state.n_known + index
    beside = (*terms[: state.n_known], *(terms[k] for k in peers))
    others = fit_jointly(record, beside, state.noise.whitener, refine=False)
    space = make_space(state.noise.whitener, others.parts, record.response_nm)
    survey = state.survey
    looks, _ = look_at(space, record, survey, others.terms, state.grams)
    old = state.accepted[index]
    seen = tuple(look for look in looks.looks if look.terms)
    own = tuple(look for look in seen if look.terms[0].cause.name == old.name)
    ranked = rank_looks(space, record, survey, (*own, *beyond_form(state, seen, old.name)))
    if not ranked:
        return False
    ranked = _names_first(ranked)
    now = [c for c in ranked if c.term.cause.name == old.name]
    naming = name_residual(space, record, ranked)
    better = not now or naming.best.score_nats > now[0].score_nats + _BETTER
    if naming.best.term.cause.name == old.name or not better:
        first = [*now, *(c for c in ranked if c not in now)]
        kept = name_residual(space, record, first)
        group = (terms[place], *kept.group[1:])
        state.accepted[index] = replace(
            old,
            group=group,
            rivals=kept.rivals,
            evidence_nats=kept.best.score_nats,
            probability=kept.probability,
        )
        return False
    state.accepted[index] = accepted_as(naming, old.false_alarm)
    fresh = (*terms[:place], naming.best.term, *terms[place + 1 :])
    state.settle(fresh)
    return True
