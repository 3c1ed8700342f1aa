"""Numbers and sentences of a calibration record."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from hdbench.report.numbers import DASH, MINUS, short

__all__ = [
    "STATEMENT",
    "declared",
    "fixed",
    "group_words",
    "percent",
    "ppm",
    "rounded_with",
    "statement",
    "two_digits",
    "volts",
]

STATEMENT = (
    "Unaccredited; traceability as declared by the operator. The results relate only to the item "
    "described, as it was when it was calibrated. Not to be reproduced except in full."
)
# significant digits of an expanded uncertainty
_DIGITS = 2


def declared(value: object) -> str:
    """Return a value as the record shows it; what is blank is not declared."""
    if value is None or value == "":
        return "not declared"
    return short(value) if isinstance(value, float) else str(value)


def fixed(value: object, digits: int) -> str:
    """Return a number with so many digits behind the point, a dash for none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return DASH
    # a zero has no sign
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", MINUS)


def percent(value: object, digits: int = 3) -> str:
    """Return a share in percent, a dash for none."""
    return fixed(100.0 * value if isinstance(value, int | float) else None, digits)


def ppm(value: object) -> str:
    """Return a share in millionths, a dash for none."""
    return fixed(1e6 * value if isinstance(value, int | float) else None, 0)


def volts(value: object) -> str:
    """Return a voltage in millivolts, a dash for none."""
    return fixed(1e3 * value if isinstance(value, int | float) else None, 2)


def rounded_with(value: float, expanded: float) -> tuple[str, str]:
    """Return a result and its expanded uncertainty, both to the second digit of the second."""
    if not (math.isfinite(expanded) and expanded > 0.0):
        return short(value), DASH
    digits = _DIGITS - 1 - math.floor(math.log10(expanded))
    places = max(0, digits)
    shown = f"{round(value, digits):.{places}f}".replace("-", MINUS)
    return shown, f"{round(expanded, digits):.{places}f}"


def two_digits(value: object) -> str:
    """Return an uncertainty with two significant digits, a dash for none."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0.0:
        return DASH
    return rounded_with(float(value), float(value))[1]


def group_words(group: Mapping[str, Any]) -> str:
    """Return what tells a group from the others, in words."""
    turn = {"cw": "clockwise", "ccw": "anticlockwise"}[str(group["direction"])]
    words = f"{turn}, {group['range']} range"
    if group.get("loading") == "couple":
        words += ", couple"
    if group.get("arm_length_m") is not None:
        words += f", arm {group['arm_length_m']:g} m"
    return words


def statement(uncertainty: Mapping[str, Any]) -> str:
    """Say what the expanded uncertainty is."""
    dof = uncertainty.get("dof")
    free = "" if dof is None else f" (from {float(dof):.3g} effective degrees of freedom)"
    return (
        "The expanded uncertainty is the standard uncertainty multiplied by "
        f"k = {float(uncertainty['coverage_factor']):.2f}{free} such that the coverage probability "
        "is about 95 %."
    )
