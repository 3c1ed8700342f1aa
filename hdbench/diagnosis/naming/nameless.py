"""What a line may be called, and lines that the catalogue has no name for."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from hdbench.diagnosis.fit.families import is_line
from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.naming.curves import CURVE_PREFIX
from hdbench.model import Cause, Motion, Parameter
from hdbench.records.trace import FloatArray

__all__ = ["line_terms", "output_line", "slow_tone", "unnamed"]


def _line_columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    angle = shape["order"] * motion.output_angle_rad
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _tone_columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    angle = 2.0 * np.pi * shape["frequency_hz"] * motion.time_s
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _nameless(
    name: str, shape: Parameter, locked_to: str, lines: Callable[..., FloatArray]
) -> Cause:
    pair = tuple(
        Parameter(part, "N m", -np.inf, np.inf, "quadrature") for part in ("cosine_nm", "sine_nm")
    )
    return Cause(
        name,
        "A cos(x + phase)",
        (shape,),
        pair,
        locked_to,
        "",
        "",
        (),
        "",
        "",
        lines,
        True,
    )


def output_line() -> Cause:
    """Return a line at any output order: no name of the catalogue has it.

    Returns
    -------
    Cause
        One shape parameter ``order``, cycles per output turn, and two quadratures, N m.
    """
    shape = Parameter("order", "1", 0.1, 1e4, "cycles per output turn")
    return _nameless("output-order line", shape, "output", _line_columns)


def slow_tone() -> Cause:
    """Return a tone below the catalogue's tones.

    Returns
    -------
    Cause
        One shape parameter ``frequency_hz``, Hz, and two quadratures, N m.
    """
    shape = Parameter("frequency_hz", "Hz", 0.0, 1e5, "frequency")
    return _nameless("tone", shape, "clock", _tone_columns)


def unnamed(term: Term) -> bool:
    """Return whether a term is a line without a name.

    Parameters
    ----------
    term : Term
        Term.

    Returns
    -------
    bool
    """
    name = term.cause.name
    return name in ("output-order line", "tone") or name.startswith(CURVE_PREFIX)


def line_terms(
    domain: str, place: float, causes: tuple[Cause, ...], motion: Motion, cell: float
) -> list[Term]:
    """Return the terms that a line at a place may be.

    Parameters
    ----------
    domain : str
        ``motor-order``, ``output-order`` or ``frequency``.
    place : float
        Order or frequency, Hz.
    causes : tuple of Cause
        Catalogue.
    motion : Motion
        Motion of the record.
    cell : float
        Resolution of the axis, its own unit.

    Returns
    -------
    list of Term
        Every cause of the catalogue that has this place in its domain; a nameless line where
        there is none, and for every output order. Within a resolution cell of output order 2 the
        angular misalignment is tried too, on less than a whole output turn as well.
    """
    if domain == "output-order":
        twice = [Term(c, {}) for c in causes if c.name == "angular-misalignment"]
        line = Term(output_line(), {"order": place})
        return [line, *twice] if abs(place - 2.0) <= cell else [line]
    key = "order" if domain == "motor-order" else "frequency_hz"
    terms = [
        Term(cause, {key: place})
        for cause in causes
        if is_line(cause)
        and len(cause.linear) == 2
        and cause.shape[0].name == key
        and cause.shape[0].contains(place)
        and cause.applicable(motion) is None
    ]
    if not terms and domain == "frequency":
        terms = [Term(slow_tone(), {key: place})]
    return terms
