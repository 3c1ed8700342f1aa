"""A strong cause weighed again in the noise that is left beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.diagnosis.detect.exact import exact_statistic
from hdbench.diagnosis.detect.looks import Look, look_at
from hdbench.diagnosis.fit.choose import with_names
from hdbench.diagnosis.fit.jointfit import JointFit, fit_jointly
from hdbench.diagnosis.fit.settle import Noise, nats, settle
from hdbench.diagnosis.fit.terms import Term, term_columns
from hdbench.diagnosis.naming.candidates import Candidate
from hdbench.diagnosis.naming.evidence import score
from hdbench.diagnosis.naming.nameless import unnamed
from hdbench.diagnosis.naming.ranking import name_residual, rank_looks
from hdbench.diagnosis.noise.whitened import Space, Whitener, make_space, make_whitener
from hdbench.diagnosis.state import State, accepted_as
from hdbench.estimation import fit_noise

__all__ = ["weigh_again"]

# a cause of this statistic, seventeen standard deviations, bends the noise that it is weighed in
_STRONG = 300.0
# candidates whose own noise is fitted
_MOST = 3
# what a candidate pays at most for its trials when candidates are ranked: a hundred thousand
_TRIALS = 12.0
# a change of the name or of the shape must gain this many nats
_BETTER = 3.0


def weigh_again(
    state: State, statistic: float, found_in: Whitener, *, only_named: bool = False
) -> bool:
    """Weigh the last cause again where it was strong enough to stand in its own noise.

    Parameters
    ----------
    state : State
        Where the search stands; changed where another name, or another shape, is likelier.
    statistic : float
        What the cause explained in the noise that it was found in.
    found_in : Whitener
        That noise.
    only_named : bool
        Hold nothing without a name against it: it came first of two names that explain as much.

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
    if len(found_in.kernel) == 1:
        # it was found in white noise
        return changed
    if not _bettered(state, _view(state, _white(state), _TRIALS), only_named):
        return changed
    view = _view(state, state.noise.whitener)
    if _bettered(state, view, only_named):
        view = _view(state, state.noise.whitener)
    _name(state, view)
    return True


def _from_white(state: State) -> bool:
    """Fit noise and terms once more from white noise; True where that is likelier.

    In turn they only creep out of a noise that an effect has bent.
    """
    fit, noise = settle(state.record, state.fit.terms, None, state.hidden, state.exponent)
    if not nats(fit, noise) > nats(state.fit, state.noise) + _BETTER:
        return False
    state.fit, state.noise = fit, noise
    return True


@dataclass(frozen=True, slots=True)
class _View:
    """What may stand in the place of the last term, as a noise shows it.

    Parameters
    ----------
    space : Space
        Residual without the last term.
    looks : tuple of Look
        Looks at it that have terms.
    ranked : list of Candidate
        Candidates, best first.
    last : Candidate
        The last term itself.
    """

    space: Space
    looks: tuple[Look, ...]
    ranked: list[Candidate]
    last: Candidate

    @property
    def to_beat(self) -> float:
        """Return what the last term explains, less what it pays, nats."""
        return _less_paid(self.last)


def _view(state: State, whitener: Whitener, spare: float = np.inf) -> _View:
    """Rank what may stand in the place of the last term in a noise.

    What is behind it by more than `spare` is left out.
    """
    record, terms, last = state.record, state.fit.terms[:-1], state.fit.terms[-1]
    others = fit_jointly(record, terms, whitener, refine=False)
    space = make_space(whitener, others.parts, record.response_nm)
    found, grams = look_at(space, record, state.survey, terms, state.grams)
    if whitener is state.noise.whitener:
        state.grams = grams
    looks = tuple(look for look in found.looks if look.terms)
    statistic, dof, _ = exact_statistic(space, term_columns(last, record))
    present = Candidate(last, statistic, dof, score(statistic, dof, 1.0))
    ranked = rank_looks(space, record, state.survey, looks, _less_paid(present) - spare)
    return _View(space, looks, ranked, present)


def _bettered(state: State, view: _View, only_named: bool) -> bool:
    """Put a likelier candidate into the place of the last term; False where there is none.

    The best ones of a view are held against the last term each in the noise that it leaves.
    """
    named = with_names(state, view.space, view.looks, view.ranked, view.to_beat - _TRIALS)
    both = named is view.ranked
    best = named[:_MOST] if both else [*view.ranked[:1], *named[: _MOST - 1]]
    wanted = view.to_beat + _BETTER
    tried = [c for c in best if _less_paid(c) > wanted and not (only_named and unnamed(c.term))]
    settled = [_in_place(state, candidate.term) for candidate in tried]
    values = [nats(*one) - _paid(c.term, c.dof) for one, c in zip(settled, tried, strict=True)]
    if not max(values, default=-np.inf) > _present(state) + _BETTER:
        return False
    state.fit, state.noise = settled[int(np.argmax(values))]
    state.settle(state.fit.terms)
    return True


def _white(state: State) -> Whitener:
    """Return the whitener of white noise as large as what is left."""
    record, valid = state.record, state.record.valid
    left = np.where(valid, record.response_nm - state.fit.fitted_nm, 0.0)
    model = fit_noise(left, valid, starts=record.starts, max_order=0, keep_lines=False)
    return make_whitener(model, valid, record.starts)


def _paid(term: Term, dof: int) -> float:
    """Return what a term pays for its parameters, nats; a table pays more by its many."""
    return -score(0.0, dof + (0 if unnamed(term) else len(term.cause.shape)), 1.0)


def _present(state: State) -> float:
    """Return the log likelihood of the present fit less what its last term pays."""
    term = state.fit.terms[-1]
    return nats(state.fit, state.noise) - _paid(term, len(term.cause.linear))


def _less_paid(candidate: Candidate) -> float:
    """Return half of what a candidate explains less what it pays, nats."""
    return 0.5 * candidate.statistic - _paid(candidate.term, candidate.dof)


def _in_place(state: State, term: Term) -> tuple[JointFit, Noise]:
    """Fit another term in the place of the last one, in the noise that it leaves."""
    terms = (*state.fit.terms[:-1], term)
    return settle(state.record, terms, None, state.hidden, state.exponent)


def _name(state: State, view: _View) -> None:
    """Name the last term in the noise that it leaves, with what else it may be."""
    rest = [c for c in view.ranked if c.term.cause.name != view.last.term.cause.name]
    naming = name_residual(view.space, state.record, [view.last, *rest])
    state.accepted[-1] = accepted_as(naming, state.accepted[-1].false_alarm)
