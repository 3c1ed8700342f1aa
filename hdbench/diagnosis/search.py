"""Accept, refit, look again: the loop that names causes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.detect.looks import SHARES, Looks, look_at
from hdbench.diagnosis.detect.scan import ScanResult
from hdbench.diagnosis.detect.scanplan import LineScan
from hdbench.diagnosis.detect.survey import Survey
from hdbench.diagnosis.fit.again import weigh_again
from hdbench.diagnosis.fit.choose import named_first, with_names
from hdbench.diagnosis.fit.formterms import accept_form, best_form, beyond_form, formed_strength
from hdbench.diagnosis.fit.jointfit import JointFit, fit_jointly
from hdbench.diagnosis.fit.rounded import (
    beyond_rounding,
    left_beyond_rounding,
    withdraw_small_steps,
)
from hdbench.diagnosis.fit.settle import Noise
from hdbench.diagnosis.fit.swap import swap_for_pair
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.record import Beyond, Record
from hdbench.diagnosis.naming.challengers import Left, challenge
from hdbench.diagnosis.naming.nameless import unnamed
from hdbench.diagnosis.naming.ranking import name_residual, rank_looks
from hdbench.diagnosis.naming.renaming import drop_needless, rename_all, strengths
from hdbench.diagnosis.naming.withheld import withheld_line
from hdbench.diagnosis.noise.whitened import Space
from hdbench.diagnosis.slowsearch import (
    SlowChoice,
    accept_slow_noise,
    drop_slow_noise,
    outweighs,
    slow_noise,
    walk_is_a_cause,
    with_walk,
)
from hdbench.diagnosis.state import Accepted, State, Walk, accepted_as
from hdbench.model import Cause

__all__ = ["Found", "search"]

_MAX_CAUSES = 8
# no form of a cause is exact: what is a hundredth of the strongest one's amplitude may be what that
# one leaves; the search ends after so many of such causes
_FORM_ERROR = 1e-4
_REMAINS = 2
# causes more than with a random walk that are looked for instead of it
_BESIDE_WALK = 2
# fewer nats of slow noise than this share of what a strong cause explains are left by its form
_SLOW_FORM = 0.02


@dataclass(frozen=True, slots=True)
class Found:
    """Result of the search.

    Parameters
    ----------
    fit : JointFit
        Final joint fit; terms that were known come first.
    noise : Noise
        Final noise.
    space : Space
        Final residual.
    accepted : tuple of Accepted
        One for each term that is not known, in order.
    left : tuple of Left
        What is left without a name.
    first_scans : mapping of str to ScanResult
        Scans of the first residual, by domain.
    last : Looks
        Looks at the last residual.
    survey : Survey
        Plan of the looks.
    record : Record
        Record that all of this is about: its motion may have been aligned anew.
    walk : Walk or None
        A random walk of the zero.
    """

    fit: JointFit
    noise: Noise
    space: Space
    accepted: tuple[Accepted, ...]
    left: tuple[Left, ...]
    first_scans: Mapping[str, ScanResult]
    last: Looks
    survey: Survey
    record: Record
    walk: Walk | None = None

    @property
    def scans(self) -> tuple[LineScan, ...]:
        """Planned scans."""
        return self.survey.scans


def search(
    record: Record,
    causes: tuple[Cause, ...],
    known: tuple[Term, ...],
    *,
    alpha: float,
    rng: np.random.Generator,
    progress: Callable[[str, float], None],
    align: Callable[[Beyond], Record] | None = None,
) -> Found:
    """Name causes until nothing passes the false-alarm rate, or eight were named.

    Parameters
    ----------
    record : Record
        Record.
    causes : tuple of Cause
        Catalogue.
    known : tuple of Term
        Causes that the model already holds: fitted, not reported.
    alpha : float
        False-alarm rate of the whole record.
    rng : Generator
        For the draws of the null.
    progress : callable
        Called with what is being done and the share done.
    align : callable or None
        Returns the record anew, given what was found; None where its motion does not depend on
        that.

    Returns
    -------
    Found
    """
    state = State.start(record, causes, known, rng)
    first_scans, looks = _accept_all(state, alpha, align, progress, _MAX_CAUSES)
    drop_slow_noise(state)
    if state.walk is not None and state.unwalked is not None:
        other = state.unwalked
        most = len(state.accepted) + _BESIDE_WALK
        # one set of Gram matrices is enough to hold: the walk's are formed anew where it stays
        state.grams = other.grams
        _, beside = _accept_all(other, alpha, align, progress, min(most, _MAX_CAUSES))
        if walk_is_a_cause(state, other):
            state, looks = other, beside
    if swap_for_pair(state, alpha):
        # what stood beside the old names may have been what they left
        while drop_needless(state):
            pass
    if len(state.accepted) > 1:
        progress("going over the names again", 0.92)
        rename_all(state)
    withdraw_small_steps(state)
    space = state.space()
    left = challenge(space, state.record, state.noise.model.innovation_std, alpha * SHARES["tests"])
    alarms = tuple(k for k in looks.looks if k.false_alarm < alpha and k.terms)
    passed = beyond_form(state, alarms)
    held_back = withheld_line(space, state.record, [k for k in alarms if k not in passed])
    return Found(
        state.fit,
        state.noise,
        space,
        tuple(state.accepted),
        (*left_beyond_rounding(state, left), *held_back),
        first_scans,
        looks,
        state.survey,
        state.record,
        state.walk,
    )


def _accept_all(
    state: State,
    alpha: float,
    align: Callable[[Beyond], Record] | None,
    progress: Callable[[str, float], None],
    most: int,
) -> tuple[Mapping[str, ScanResult], Looks]:
    """Accept causes until nothing passes, or `most` were; return first scans and last looks."""
    looks, more = _once(state, alpha, align, progress, most)
    first_scans = looks.scans
    while more:
        looks, more = _once(state, alpha, align, progress, most)
    return first_scans, looks


def _once(
    state: State,
    alpha: float,
    align: Callable[[Beyond], Record] | None,
    progress: Callable[[str, float], None],
    most: int,
) -> tuple[Looks, bool]:
    """Look at the residual and accept a cause; False where that was the last look."""
    space = state.space()
    progress("scanning the residual", min(0.9, 0.1 + 0.2 * len(state.accepted)))
    looks, state.grams = look_at(space, state.record, state.survey, state.fit.terms, state.grams)
    count = sum(not one.form for one in state.accepted)
    if count >= most or _only_remains(state):
        return looks, False
    return looks, _step(state, space, looks, alpha, align)


def _only_remains(state: State) -> bool:
    """Return whether the last causes are no more than the form of the strongest one leaves."""
    if len(state.accepted) <= _REMAINS:
        return False
    losses = strengths(state.fit)[state.n_known :]
    if any(one.form for one in state.accepted[-_REMAINS:]):
        return False
    return max(losses[-_REMAINS:]) < _FORM_ERROR * max(losses)


def _step(
    state: State,
    space: Space,
    looks: Looks,
    alpha: float,
    align: Callable[[Beyond], Record] | None,
) -> bool:
    """Accept the best name, or a noise that rises towards 0 Hz; False where nothing passes."""
    every = beyond_rounding(state, space, tuple(look for look in looks.looks if look.terms))
    alarms = tuple(look for look in every if look.false_alarm < alpha)
    slow = slow_noise(state, space)
    if slow is not None and slow.most_nats < _SLOW_FORM * formed_strength(state):
        slow = None
    if not alarms and not _slow_chance(slow) < alpha:
        return False
    if alarms and _took_form(state, space, looks):
        return True
    alarms = beyond_form(state, alarms)
    if not alarms and not _slow_chance(slow) < alpha:
        return False
    seen = beyond_form(state, every)
    ranked = rank_looks(space, state.record, state.survey, seen) if alarms else []
    named = with_names(state, space, seen, ranked)
    # a head that has a name is both
    heads = [ranked] if not named or named is ranked else [named, ranked]
    if slow is not None and all(outweighs(slow, head) for head in heads):
        chance = min([_slow_chance(slow), *(look.false_alarm for look in alarms)])
        accept_slow_noise(state, slow.likelier(), ranked, chance)
        return True
    if not ranked or not ranked[0].score_nats > 0.0:
        return False
    before, ranked = ranked, named_first(state, space, seen, named, ranked)
    put_first = unnamed(before[0].term) and not unnamed(ranked[0].term)
    naming = with_walk(state, name_residual(space, state.record, ranked), slow)
    state.accepted.append(accepted_as(naming, min(look.false_alarm for look in alarms)))
    state.paid_nats += 0.5 * naming.best.statistic - naming.best.score_nats
    terms = (*state.fit.terms, naming.best.term)
    state.fit = fit_jointly(state.record, terms, state.noise.whitener)
    _settled(state, align)
    if weigh_again(state, naming.best.statistic, space.whitener, only_named=put_first):
        _settled(state, align)
    drop_needless(state)
    withdraw_small_steps(state)
    return True


def _slow_chance(slow: SlowChoice | None) -> float:
    """Return the probability of such a slow noise without any effect."""
    if slow is None:
        return 1.0
    return min(1.0, float(np.exp(-slow.likelier().gain_nats)) / SHARES["slow"])


def _settled(state: State, align: Callable[[Beyond], Record] | None) -> None:
    """Fit terms and noise anew, and the motion where that depends on them."""
    if align is None:
        state.settle(state.fit.terms)
    else:
        state.realign(align)


def _took_form(state: State, space: Space, looks: Looks) -> bool:
    """Charge what is left to the form of a strong cause where that explains it; True if so."""
    if not state.accepted:
        return False
    losses = strengths(state.fit)[state.n_known :]
    form = best_form(state, space, losses)
    best = max(look.statistic for look in looks.looks if look.terms)
    return form is not None and accept_form(state, form, best)
