"""Two names for what others were named for: the last step of a search."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.detect.looks import look_at_families
from hdbench.diagnosis.fit.jointfit import fit_jointly
from hdbench.diagnosis.fit.pairs import Pair, best_pairs, takes_part
from hdbench.diagnosis.fit.settle import nats, settle
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.naming.curveplaces import is_curve
from hdbench.diagnosis.naming.evidence import score
from hdbench.diagnosis.noise.whitened import make_space
from hdbench.diagnosis.state import Accepted, State

__all__ = ["swap_for_pair"]

# more names than these are no mistake for two
_FEW = 4
# a pair must gain this many nats over what it replaces, beside what its choice costs; in the place
# of one name it is a finding more, and as sure as any
_BETTER = 1.0
# the best shape beside another cause may lie off that of each alone: so many nats short are tried
_SHORT = 10.0
# pairs whose own noise is fitted
_MOST = 3


def swap_for_pair(state: State, alpha: float) -> bool:
    """Put two families into the place of all those accepted, where they are likelier.

    Two causes may look like a third one, and what that one leaves like a fourth.

    Parameters
    ----------
    state : State
        Where the search stands; changed where a pair is likelier.
    alpha : float
        Probability of a finding without an effect, in (0, 1).

    Returns
    -------
    bool
        True where it changed.
    """
    named = list(enumerate(zip(state.accepted, state.fit.terms[state.n_known :], strict=True)))
    if any(one.form for one in state.accepted) or state.exponent > 0.0:
        # beside a slow noise everything slow is worth little, alone or in pairs
        return False
    gone = [k for k, (_, term) in named if takes_part(term) or is_curve(term)]
    if not 0 < len(gone) <= _FEW or (state.record.weighty and 0 in gone):
        return False
    kept = [k for k, _ in named if k not in gone]
    known = state.fit.terms[: state.n_known]
    others = (*known, *(state.fit.terms[state.n_known + k] for k in kept))
    old = [state.fit.terms[state.n_known + k] for k in gone]
    pairs = _pairs_beside(state, others, old)
    if not pairs:
        return False
    worth = [_worth(state, others, pair.terms) for pair in pairs]
    best = int(np.argmax(worth))
    pair = pairs[best]
    now = nats(state.fit, state.noise) - _paid(old)
    picked = _picked(pair, len(old))
    one_more = len(old) == 1 and not is_curve(old[0])
    better = -float(np.log(alpha)) if one_more else _BETTER
    if not worth[best] - picked > now + better:
        return False
    chance = min(state.accepted[k].false_alarm for k in gone)
    state.accepted = [
        *(state.accepted[k] for k in kept),
        *(Accepted(t.cause.name, chance, pair.score_nats, (t,), ()) for t in pair.terms),
    ]
    state.settle((*others, *pair.terms))
    return True


def _picked(pair: Pair, count: int) -> float:
    """Return what choosing a pair costs beyond choosing so many names one by one, nats."""
    # k families make k (k - 1) / 2 pairs, about k^2 / 2
    one = 0.5 * (pair.trials_nats + float(np.log(2.0)))
    return pair.trials_nats - count * one


def _worth(state: State, others: tuple[Term, ...], terms: tuple[Term, ...]) -> float:
    """Return the log likelihood of terms beside others in their own noise less what they pay."""
    parts = (state.noise, state.hidden, state.exponent)
    return nats(*settle(state.record, (*others, *terms), *parts)) - _paid(terms)


def _pairs_beside(state: State, others: tuple[Term, ...], old: list[Term]) -> list[Pair]:
    """Return the best pairs beside the other terms that come near the old ones."""
    record, whitener = state.record, state.noise.whitener
    fit = fit_jointly(record, others, whitener, refine=False)
    space = make_space(whitener, fit.parts, record.response_nm)
    looks, state.grams = look_at_families(space, state.survey, state.grams)
    wanted = max(0.5 * (fit.chi2 - state.fit.chi2) - _paid(old) - _SHORT, _BETTER)
    names = {term.cause.name for term in old}
    pairs = (k for k in best_pairs(space, record, looks) if k.score_nats > wanted)
    return [k for k in pairs if not {t.cause.name for t in k.terms} <= names][:_MOST]


def _paid(terms: list[Term] | tuple[Term, ...]) -> float:
    """Return what terms pay for their parameters, nats."""
    return sum(-score(0.0, len(t.cause.linear) + len(t.cause.shape), 1.0) for t in terms)
