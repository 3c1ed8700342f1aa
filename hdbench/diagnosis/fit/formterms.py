"""The form of a strong cause: what its one shape leaves is taken up by the same at other shapes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hdbench.diagnosis.detect.exact import exact_statistic
from hdbench.diagnosis.detect.looks import Look
from hdbench.diagnosis.fit.axes import axes_of
from hdbench.diagnosis.fit.families import is_line, is_step
from hdbench.diagnosis.fit.terms import Term, term_columns
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.evidence import score
from hdbench.diagnosis.naming.nameless import unnamed
from hdbench.diagnosis.noise.whitened import Space
from hdbench.diagnosis.state import Accepted, State
from hdbench.model import shape_bounds

__all__ = ["FormOf", "accept_form", "best_form", "beyond_form"]

# a cause of seventeen standard deviations shows a form that is off by a third with five
_STRONG = 300.0
# what a form leaves is no more than this share of the cause: a third of its amplitude
_MOST = 0.1
# shapes apart by so much span a function that passes over slowly, as one that does so fast: an
# arctangent beside a hyperbolic tangent leaves a seventh, without the third shape most of its tail
_FACTORS = (0.25, 4.0, 16.0)
# a name explains what a form does too where the form has this share of its statistic
_SHARE = 0.8


# the form of a strong cause is known to a tenth of its amplitude: less is no cause of its own
_FORM_ERROR = 0.01
# what acts on the same axis, or is told apart from it by a run of its own, is no cause of its own
# either below a twentieth: a fifth of the amplitude, what other laws of the same friction differ by
_KIN_ERROR = 0.05
# where a form is off for a moment it leaves a little of everything: a hundredth of its amplitude
_ANY_ERROR = 1e-4
# a tone slower than this follows the course of the motion as a form does; hums are faster
_SLOW_HZ = 5.0


@dataclass(frozen=True, slots=True)
class FormOf:
    """Further shapes of an accepted cause.

    Parameters
    ----------
    index : int
        Index of the cause among the accepted.
    terms : tuple of Term
        The same cause at other shapes.
    statistic : float
        What they explain.
    score_nats : float
        Their score.
    """

    index: int
    terms: tuple[Term, ...]
    statistic: float
    score_nats: float


def best_form(state: State, space: Space, losses: list[float]) -> FormOf | None:
    """Return the further shapes that explain most of a residual.

    Parameters
    ----------
    state : State
        Where the search stands.
    space : Space
        Its residual.
    losses : list of float
        What the loss of each accepted term would cost.

    Returns
    -------
    FormOf or None
        None where no strong cause has shapes, or all of these were extended before.
    """
    found: list[FormOf] = []
    extended = {one.name for one in state.accepted if one.form}
    for index, (one, loss) in enumerate(zip(state.accepted, losses, strict=True)):
        term = state.fit.terms[state.n_known + index]
        if one.form or one.name in extended or loss < _STRONG or not _has_axis(term):
            continue
        terms = _others(term, state.record)
        if not terms:
            continue
        columns = np.hstack([term_columns(other, state.record) for other in terms])
        # what the cause itself has of them is explained: the rest counts, however small it is
        main = term_columns(term, state.record)
        columns -= main @ np.linalg.lstsq(main.T @ main, main.T @ columns, rcond=None)[0]
        statistic, dof, _ = exact_statistic(space, columns)
        if statistic <= _MOST * loss:
            found.append(FormOf(index, terms, statistic, score(statistic, dof, 1.0)))
    return max(found, key=lambda form: form.score_nats, default=None)


def beyond_form(state: State, looks: tuple[Look, ...], beside: str = "") -> tuple[Look, ...]:
    """Return the looks that are more than what the form of an accepted cause may leave.

    Parameters
    ----------
    state : State
        Where the search stands.
    looks : tuple of Look
        Looks that have terms.
    beside : str
        Name of a cause that is not in the residual's fit: it has no form there, and no look.

    Returns
    -------
    tuple of Look
        Those above a twentieth of a cause that has a form and acts on the same axis, or is a
        look-alike, and above a hundredth of any other; lines over motor order and fast tones, which
        no slow function of the motion makes, above a ten-thousandth.
    """
    formed = [(term, size) for term, size in _formed_terms(state) if term.cause.name != beside]
    other = (k for k in looks if k.terms[0].cause.name != beside)
    return tuple(k for k in other if k.statistic > _form_limit(formed, k.terms[0]))


def formed_strength(state: State) -> float:
    """Return what the strongest accepted cause with a form explains.

    Parameters
    ----------
    state : State
        Where the search stands.

    Returns
    -------
    float
        Fall of the whitened sum of squares; 0 where no cause has a form.
    """
    return max((strength for _, strength in _formed_terms(state)), default=0.0)


def _formed_terms(state: State) -> list[tuple[Term, float]]:
    """Return the accepted terms that have a form, with what they explain.

    When they were accepted, or now: the noise may have been bent by them then, and other shapes may
    stand in for them now.
    """
    found = []
    for index, one in enumerate(state.accepted):
        place = state.n_known + index
        if _has_form(state.fit.terms[place]):
            size = max(2.0 * one.evidence_nats, state.fit.loss(place))
            found.append((state.fit.terms[place], size))
    return found


def _form_limit(formed: list[tuple[Term, float]], term: Term) -> float:
    """Return the statistic up to which the forms of the accepted terms may leave a term."""
    follows = _follows_motion(term)
    limits = [
        size * (_KIN_ERROR if _kin(main, term) else _FORM_ERROR) if follows else size * _ANY_ERROR
        for main, size in formed
    ]
    return max(limits, default=0.0)


def _kin(main: Term, other: Term) -> bool:
    """Return whether a term acts on the axis of another or is a look-alike of it."""
    first, second = main.cause, other.cause
    alike = second.name in first.look_alikes or first.name in second.look_alikes
    # a slow tone is one of the motion's own harmonics
    return alike or "frequency_hz" in other.shape or bool(axes_of(main) & axes_of(other))


def _follows_motion(term: Term) -> bool:
    """Return whether a term can be made of what a slow function of the motion leaves."""
    if "frequency_hz" in term.shape:
        return term.shape["frequency_hz"] < _SLOW_HZ
    return term.cause.locked_to != "motor"


def _has_form(term: Term) -> bool:
    """Return whether a cause has a law that may be another: a line is a line."""
    return not (is_line(term.cause) or unnamed(term) or term.cause.locked_to == "motor")


def _has_axis(term: Term) -> bool:
    """Return whether a cause has shapes over which it can be spread: places are none."""
    placed = is_line(term.cause) or is_step(term.cause) or unnamed(term)
    return bool(term.shape) and not placed


def _others(term: Term, record: Record) -> tuple[Term, ...]:
    """Return the term at other shapes, one shape parameter moved at a time."""
    bounds = shape_bounds(term.cause, record.motion)
    terms = []
    for name, value in term.shape.items():
        for factor in _FACTORS:
            moved = value * factor
            if any(low <= moved <= high for low, high in bounds[name]):
                terms.append(replace(term, shape={**term.shape, name: moved}, form=True))
    return tuple(terms)


def accept_form(state: State, form: FormOf, statistic: float) -> bool:
    """Take further shapes into the fit where they explain what the best name would.

    Parameters
    ----------
    state : State
        Where the search stands; changed.
    form : FormOf
        Further shapes.
    statistic : float
        What the best name explains.

    Returns
    -------
    bool
        True where they were taken.
    """
    if not (form.score_nats > 0.0 and form.statistic >= _SHARE * statistic):
        return False
    main = state.accepted[form.index]
    state.accepted += [
        Accepted(main.name, main.false_alarm, form.score_nats, (term,), (), True)
        for term in form.terms
    ]
    state.settle((*state.fit.terms, *form.terms))
    return True
