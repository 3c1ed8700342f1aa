"""A strong cause weighed again in the noise that is left beside it."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.detect.exact import exact_statistic
from hdbench.diagnosis.detect.looks import look_at
from hdbench.diagnosis.fit.choose import with_names
from hdbench.diagnosis.fit.jointfit import fit_jointly
from hdbench.diagnosis.fit.settle import nats, settle
from hdbench.diagnosis.fit.terms import Term, term_columns
from hdbench.diagnosis.naming.candidates import Candidate
from hdbench.diagnosis.naming.evidence import score
from hdbench.diagnosis.naming.nameless import unnamed
from hdbench.diagnosis.naming.ranking import name_residual, rank_looks
from hdbench.diagnosis.noise.whitened import Whitener, make_space, make_whitener
from hdbench.diagnosis.state import State, accepted_as
from hdbench.estimation import fit_noise

__all__ = ["weigh_again"]

# a cause of this statistic, seventeen standard deviations, bends the noise that it is weighed in
_STRONG = 300.0
# rounds; the second finds what the first one's noise still hid
_ROUNDS = 2
# candidates whose own noise is fitted
_MOST = 3
# a change of the name or of the shape must gain this many nats
_BETTER = 3.0


def weigh_again(state: State, statistic: float) -> bool:
    """Weigh the last cause again where it was strong enough to stand in its own noise.

    Parameters
    ----------
    state : State
        Where the search stands; changed where another name, or another shape, is likelier.
    statistic : float
        What the cause explained in the noise that it was found in.

    Returns
    -------
    bool
        True where it changed: the fit is to be settled with what changed with it.

    Notes
    -----
    A noise model that was fitted while a large effect was still in the residual takes part of
    the effect for colour: a step is a single impulse there. What is found in it is only the first
    guess of a name and of a shape. The second comes from a look in white noise, which no effect can
    bend, a third from the noise that the second one leaves. Those that explain more there than what
    was taken are each held against it in a noise of their own.
    """
    if not statistic > _STRONG:
        return False
    changed = _from_white(state)
    whitener = _white(state)
    for _ in range(_ROUNDS):
        if not _weighed(state, whitener):
            break
        changed, whitener = True, state.noise.whitener
    return changed


def _from_white(state: State) -> bool:
    """Fit noise and terms once more from white noise; True where that is likelier.

    In turn they only creep out of a noise that an effect has bent.
    """
    fit, noise = settle(state.record, state.fit.terms, None, state.hidden, state.exponent)
    if not nats(fit, noise) > nats(state.fit, state.noise) + _BETTER:
        return False
    state.fit, state.noise = fit, noise
    return True


def _weighed(state: State, whitener: Whitener) -> bool:
    """Name the last cause again in a noise; True where another name or shape is likelier."""
    tried = _promising(state, whitener)
    valued = [(_own_noise(state, c), -k) for k, c in enumerate(tried)]
    value, place = max(valued, default=(-np.inf, 0))
    if not value > _present(state) + _BETTER:
        return False
    _take(state, tried[-place])
    return True


def _white(state: State) -> Whitener:
    """Return the whitener of white noise as large as what is left."""
    record, valid = state.record, state.record.valid
    left = np.where(valid, record.response_nm - state.fit.fitted_nm, 0.0)
    model = fit_noise(left, valid, starts=record.starts, max_order=0, keep_lines=False)
    return make_whitener(model, valid, record.starts)


def _promising(state: State, whitener: Whitener) -> list[Candidate]:
    """Return the best candidates for the last term in a noise, of those better than it."""
    record, terms = state.record, state.fit.terms[:-1]
    others = fit_jointly(record, terms, whitener, refine=False)
    space = make_space(whitener, others.parts, record.response_nm)
    looks, _ = look_at(space, record, state.survey, terms, state.grams)
    seen = tuple(look for look in looks.looks if look.terms)
    ranked = rank_looks(space, record, state.survey, seen)
    named = with_names(state, space, seen, ranked)
    best = named[:_MOST] if named is ranked else [*ranked[:1], *named[: _MOST - 1]]
    last = state.fit.terms[-1]
    columns = term_columns(last, record)
    statistic, dof, _ = exact_statistic(space, columns)
    present = 0.5 * statistic - _paid(last, dof)
    return [c for c in best if 0.5 * c.statistic - _paid(c.term, c.dof) > present + _BETTER]


def _paid(term: Term, dof: int) -> float:
    """Return what a term pays for its parameters, nats; a table pays more by its many."""
    return -score(0.0, dof + (0 if unnamed(term) else len(term.cause.shape)), 1.0)


def _present(state: State) -> float:
    """Return the log likelihood of the present fit less what its last term pays."""
    term = state.fit.terms[-1]
    return nats(state.fit, state.noise) - _paid(term, len(term.cause.linear))


def _own_noise(state: State, candidate: Candidate) -> float:
    """Return the log likelihood with a candidate for the last term in the noise that it leaves."""
    terms = (*state.fit.terms[:-1], candidate.term)
    fit, noise = settle(state.record, terms, None, state.hidden, state.exponent)
    return nats(fit, noise) - _paid(candidate.term, candidate.dof)


def _take(state: State, candidate: Candidate) -> None:
    """Put a candidate into the place of the last term, with the names that it may have there."""
    terms = (*state.fit.terms[:-1], candidate.term)
    parts = (state.record, terms, None, state.hidden, state.exponent)
    state.fit, state.noise = settle(*parts)
    state.settle(state.fit.terms)
    record, whitener = state.record, state.noise.whitener
    others = fit_jointly(record, state.fit.terms[:-1], whitener, refine=False)
    space = make_space(whitener, others.parts, record.response_nm)
    looks, state.grams = look_at(space, record, state.survey, others.terms, state.grams)
    last = state.fit.terms[-1]
    statistic = others.chi2 - state.fit.chi2
    value = score(statistic, candidate.dof, 1.0)
    rest = rank_looks(space, record, state.survey, tuple(k for k in looks.looks if k.terms))
    first = Candidate(last, statistic, candidate.dof, value)
    kept = [c for c in rest if c.term.cause.name != last.cause.name]
    naming = name_residual(space, record, [first, *kept])
    state.accepted[-1] = accepted_as(naming, state.accepted[-1].false_alarm)
