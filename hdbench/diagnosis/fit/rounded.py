"""What a converter with coarse steps may leave: nothing larger than two of its steps."""

from __future__ import annotations

from dataclasses import replace

from hdbench.diagnosis.detect.exact import exact_statistic
from hdbench.diagnosis.detect.looks import Look
from hdbench.diagnosis.fit.families import is_step
from hdbench.diagnosis.fit.terms import term_columns
from hdbench.diagnosis.naming.left import Left
from hdbench.diagnosis.naming.renaming import take_out
from hdbench.diagnosis.noise.whitened import Space
from hdbench.diagnosis.state import State

__all__ = ["beyond_rounding", "left_beyond_rounding", "withdraw_small_steps"]

# a reading is off by half a step, the model of its rounding by as much: what is left is within one
# step, and changes by no more than two
_LEFT = 1.0
_CHANGE = 2.0
# domains in which a reading stands out that is held for a moment, or jumps by a step; how much
# rounded readings scatter depends on where in a step the torque lies, however far apart the steps
_OF_A_MOMENT = ("time", "outliers")
_SCATTER = "variance"


def beyond_rounding(state: State, space: Space, looks: tuple[Look, ...]) -> tuple[Look, ...]:
    """Return the looks that are more than a reading's rounding.

    In noise that rises towards 0 Hz a step of the zero is seen at its moment alone. Within two of
    the converter's it may be a torque that passes from one level to the next.

    Parameters
    ----------
    state : State
        Where the search stands.
    space : Space
        Residual that the looks belong to.
    looks : tuple of Look
        Looks that have terms.

    Returns
    -------
    tuple of Look
        All of them where the steps are fine, or the noise is the same at all frequencies.
    """
    if state.rounding is None or not state.exponent > 0.0:
        return looks
    if state.rounding.hides_steps:
        return tuple(look for look in looks if not is_step(look.terms[0].cause))
    most_nm = _CHANGE * state.rounding.step_nm
    return tuple(look for look in looks if _size_nm(state, space, look) > most_nm)


def withdraw_small_steps(state: State) -> None:
    """Take out steps of the zero that came down to a reading's rounding once all was fitted.

    Parameters
    ----------
    state : State
        Where the search stands; changed where there are such steps: no other is looked for then.
    """
    index = len(state.accepted)
    while state.rounding is not None and state.exponent > 0.0 and index > 0:
        index -= 1
        place = state.n_known + index
        if not is_step(state.fit.terms[place].cause):
            continue
        if abs(float(state.fit.linear[place][0])) <= _CHANGE * state.rounding.step_nm:
            take_out(state, index)
            state.rounding = replace(state.rounding, hides_steps=True)


def _size_nm(state: State, space: Space, look: Look) -> float:
    """Return the size of a step of the zero, N m; infinite for anything else."""
    (term, *_) = look.terms
    if not is_step(term.cause):
        return float("inf")
    return abs(float(exact_statistic(space, term_columns(term, state.record))[2][0]))


def left_beyond_rounding(state: State, left: list[Left]) -> list[Left]:
    """Return what is left without what coarse steps make of any torque.

    Parameters
    ----------
    state : State
        Where the search stands.
    left : list of Left
        What is left.

    Returns
    -------
    list of Left
        All of it where the steps are fine.
    """
    if state.rounding is None:
        return left
    most_nm = _LEFT * state.rounding.step_nm
    kept = [one for one in left if one.domain != _SCATTER]
    return [one for one in kept if one.domain not in _OF_A_MOMENT or one.size_nm > most_nm]
