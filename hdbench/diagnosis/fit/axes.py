"""Axes that a term acts on: what shares one with a strong cause may be what its form leaves."""

from __future__ import annotations

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.naming.curves import CURVE_PREFIX

__all__ = ["axes_of"]

_CURVES = {"velocity": "velocity", "torque": "load", "time": "time", "acceleration": "acceleration"}


def axes_of(term: Term) -> frozenset[str]:
    """Return the axes that a term acts on.

    Parameters
    ----------
    term : Term
        Term.

    Returns
    -------
    frozenset of str
        What the cause is locked to; a loop turns where the motion turns, as friction does; a table
        has the axis that it is over.
    """
    name = term.cause.name
    if name.startswith(CURVE_PREFIX):
        words = name.removeprefix(CURVE_PREFIX).split()
        return frozenset({_CURVES.get(words[0], words[0])})
    turning = {"velocity"} if "direction" in term.cause.parity else set()
    return frozenset({term.cause.locked_to, *turning})
