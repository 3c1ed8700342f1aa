"""Whether what is left is a noise that rises towards 0 Hz, or a cause."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from hdbench.diagnosis.fit.jointfit import fit_jointly
from hdbench.diagnosis.fit.settle import InSlow, nats, settle
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.naming.candidates import Candidate
from hdbench.diagnosis.naming.curves import CURVE_PREFIX
from hdbench.diagnosis.naming.nameless import unnamed
from hdbench.diagnosis.naming.ranking import RIVAL_NATS, Naming
from hdbench.diagnosis.noise.slownoise import FLICKER, RANDOM_WALK, SlowNoise, slow_spectrum
from hdbench.diagnosis.noise.whitened import Space, make_space
from hdbench.diagnosis.state import State, Walk
from hdbench.model import catalogue

__all__ = [
    "SlowChoice",
    "accept_slow_noise",
    "drop_slow_noise",
    "outweighs",
    "slow_noise",
    "walk_is_a_cause",
    "with_walk",
]

_OVER_TIME = CURVE_PREFIX + "time"
# what a slow noise pays for its power, and by how much a cause must beat it: a step or a drift
# takes the largest part of any random walk, nats
_SLOW_COST = 3.0
_SLOW_BONUS = 5.0
# a cause that explains this many times as much needs no comparison
_FAR = 3.0
# names that are held against a walk in noise of their own, and a ratio that is beyond all doubt
_TRIED = 5
_MOST_NATS = 100.0


@dataclass(slots=True)
class SlowChoice:
    """Noise that rises towards 0 Hz; which kind it is, is settled where it is asked for.

    Parameters
    ----------
    state : State
        Where the search stands.
    flicker, walk : SlowNoise
        The most likely one of either kind.
    chosen : SlowNoise or None
        The likelier one, once it was asked for.
    """

    state: State
    flicker: SlowNoise
    walk: SlowNoise
    chosen: SlowNoise | None = None

    @property
    def most_nats(self) -> float:
        """Largest gain of either kind, nats."""
        return max(self.flicker.gain_nats, self.walk.gain_nats)

    def likelier(self) -> SlowNoise:
        """Return a random walk unless flicker is plainly likelier."""
        if self.chosen is None:
            self.chosen = self.flicker
            if self.most_nats >= _SLOW_COST:
                # the spectrum is that of a residual whose colour took a part of either: with their
                # own colour
                flicker, walk = (_alone(self.state, slow) for slow in (self.flicker, self.walk))
                self.chosen = self.flicker if flicker - walk > RIVAL_NATS else self.walk
        return self.chosen


def slow_noise(state: State, space: Space) -> SlowChoice | None:
    """Return the most likely noise that rises towards 0 Hz.

    Parameters
    ----------
    state : State
        Where the search stands.
    space : Space
        Its residual.

    Returns
    -------
    SlowChoice or None
        None where one was accepted before, or may not be.
    """
    if state.exponent > 0.0 or not state.may_walk:
        return None
    spectrum = slow_spectrum(space)
    return SlowChoice(state, *(spectrum.fit(exponent) for exponent in (FLICKER, RANDOM_WALK)))


def outweighs(choice: SlowChoice, ranked: list[Candidate]) -> bool:
    """Return whether a slow noise explains more than the best cause and slow noise beside it.

    A table over time is no cause to be held against it: it follows any walk.

    Parameters
    ----------
    choice : SlowChoice
        Noise.
    ranked : list of Candidate
        Candidates, best first.

    Returns
    -------
    bool
        Several causes that change slowly look like one slow noise until the first of them is taken
        out.
    """
    # what changes slowly is held against the walk itself: the autoregression that both were
    # scored in has taken most of a large one
    far = bool(ranked) and not _is_slow(ranked[0].term)
    if far and ranked[0].score_nats > _FAR * choice.most_nats:
        return False
    slow = choice.likelier()
    if not slow.gain_nats > _SLOW_COST:
        return False
    if not ranked or ranked[0].term.cause.name == _OVER_TIME:
        return True
    best = ranked[0]
    if far and best.score_nats > _FAR * slow.gain_nats:
        return False
    state = choice.state
    record, hidden, terms = state.record, state.hidden, state.fit.terms
    alone = _alone(state, slow)
    joint = fit_jointly(record, (*terms, best.term), state.noise.whitener)
    fit, noise = settle(record, joint.terms, state.noise, hidden)
    beside = make_space(noise.whitener, fit.parts, record.response_nm)
    rest = slow_spectrum(beside).fit(slow.exponent).gain_nats - _SLOW_COST
    paid = 0.5 * best.statistic - best.score_nats
    return alone - _SLOW_COST + _SLOW_BONUS > nats(fit, noise) - paid + max(rest, 0.0)


def _is_slow(term: Term) -> bool:
    """Return whether a term changes slowly, with time alone or as a memory of the load."""
    slow = term.cause.locked_to == "time" or "time_constant_s" in term.shape
    return slow or term.cause.name == _OVER_TIME


def _alone(state: State, slow: SlowNoise) -> float:
    """Return the log likelihood of the present terms in a slow noise, fitted once."""
    last = state.in_slow
    if last is None or not (
        last.fit is state.fit and last.noise is state.noise and last.exponent == slow.exponent
    ):
        parts = (state.fit.terms, state.noise, state.hidden, slow.exponent)
        value = nats(*settle(state.record, *parts))
        last = state.in_slow = InSlow(state.fit, state.noise, slow.exponent, value)
    return last.nats


def accept_slow_noise(
    state: State, slow: SlowNoise, ranked: list[Candidate], chance: float
) -> None:
    """Make a slow noise part of the noise; a random walk of the zero is a cause too.

    Parameters
    ----------
    state : State
        Where the search stands; changed.
    slow : SlowNoise
        Noise.
    ranked : list of Candidate
        Candidates, best first.
    chance : float
        Probability of such a finding without any effect.
    """
    rivals = _beside_walk(state, slow, ranked) if slow.exponent == RANDOM_WALK else ()
    if slow.exponent == RANDOM_WALK:
        # it may not be needed again
        state.noise.whitener.forget()
        state.unwalked = replace(state, accepted=[*state.accepted], may_walk=False)
        state.walk = Walk(slow, chance, rivals)
    state.exponent = slow.exponent
    state.paid_nats += _SLOW_COST
    state.settle(state.fit.terms)


def drop_slow_noise(state: State) -> None:
    """Take back a noise that rises towards 0 Hz where the causes named since leave none of it.

    Two causes that hide each other may first look like one slow noise.

    Parameters
    ----------
    state : State
        Where the search stands; changed where the slow noise no longer pays for itself.
    """
    if not state.exponent > 0.0 or not state.accepted:
        return
    fit, noise = settle(state.record, state.fit.terms, state.noise, state.hidden)
    if nats(state.fit, state.noise) - nats(fit, noise) > _SLOW_COST:
        return
    state.exponent, state.walk = 0.0, None
    state.paid_nats -= _SLOW_COST
    state.settle(state.fit.terms)


def walk_is_a_cause(walked: State, other: State) -> bool:
    """Return whether one slow cause, with what stands beside it, explains more than a walk.

    A walk takes a drift together with what hides beside it, one of them alone does not.

    Parameters
    ----------
    walked : State
        End of the search with the walk.
    other : State
        End of the search without.

    Returns
    -------
    bool
        Never where it takes several slow causes, or a table over time: these are a walk in pieces.
    """
    slow = [term for term in other.fit.terms if _is_slow(term) and not term.known]
    beside = [term for term in walked.fit.terms if _is_slow(term) and not term.known]
    if len(slow) > len(beside) + 1 or any(unnamed(term) for term in slow):
        return False
    more = nats(other.fit, other.noise) - nats(walked.fit, walked.noise)
    return more > other.paid_nats - walked.paid_nats + _SLOW_BONUS


def _beside_walk(state: State, slow: SlowNoise, ranked: list[Candidate]) -> tuple[str, ...]:
    """Return the names within 3 nats of a walk, each in the noise that it leaves itself."""
    near = slow.gain_nats - _SLOW_COST - RIVAL_NATS
    close: dict[str, Candidate] = {}
    for one in ranked:
        if one.score_nats >= near and not unnamed(one.term):
            close.setdefault(one.term.cause.name, one)
    terms = state.fit.terms
    alone = _alone(state, slow)
    rivals = []
    for name, one in [*close.items()][:_TRIED]:
        beside = settle(state.record, (*terms, one.term), state.noise, state.hidden)
        paid = 0.5 * one.statistic - one.score_nats
        if nats(*beside) - paid >= alone - _SLOW_COST - RIVAL_NATS:
            rivals.append(name)
    return tuple(rivals)


def with_walk(state: State, naming: Naming, choice: SlowChoice | None) -> Naming:
    """Return a naming with the random walk of the zero among its rivals, where it is one.

    Parameters
    ----------
    state : State
        Where the search stands.
    naming : Naming
        Best name, group and rivals.
    choice : SlowChoice or None
        Most likely slow noise of the residual.

    Returns
    -------
    Naming
    """
    if choice is None or choice.most_nats - _SLOW_COST < naming.best.score_nats - RIVAL_NATS:
        return naming
    slow = choice.likelier()
    if slow.exponent != RANDOM_WALK:
        return naming
    if slow.gain_nats - _SLOW_COST < naming.best.score_nats - RIVAL_NATS:
        return naming
    # a large effect stands in the noise that both were scored in: each in the noise that it leaves
    terms = state.fit.terms
    alone = _alone(state, slow)
    beside = settle(state.record, (*terms, naming.best.term), state.noise, state.hidden)
    paid = 0.5 * naming.best.statistic - naming.best.score_nats
    behind = nats(*beside) - paid - (alone - _SLOW_COST)
    if behind > RIVAL_NATS:
        return naming
    walk = Term(catalogue()["zero-random-walk"], {})
    share = naming.probability / (1.0 + naming.probability * math.exp(min(-behind, _MOST_NATS)))
    return replace(naming, rivals=(*naming.rivals, walk), probability=share)
