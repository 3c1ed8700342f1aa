"""Numbers and parameters as a person reads them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from hdbench.records import Quantity
from hdbench.results import MisalignmentResult, RippleResult
from hdbench.results.diagnosis import ParameterValue

# units that a name ends in, the longest first: they stand beside the number anyway
_UNIT_SUFFIXES = (
    *("_nm_per_sqrt_s", "_nm_s_per_rad", "_nm_per_s", "_nm_per_a", "_kg_m2"),
    *("_rad_s", "_nm", "_hz", "_rad", "_s", "_v"),
)
MINUS, DASH, NBSP = "\N{MINUS SIGN}", "\N{EN DASH}", "\N{NO-BREAK SPACE}"


def short(value: float, std: float | None = None) -> str:
    """Return a number with as many digits as its uncertainty allows.

    Examples
    --------
    >>> short(6.6123, 0.0484), short(0.4), short(123456.7, 120.0)
    ('6.612', '0.4', '123460')
    """
    if not std or not math.isfinite(std):
        text = f"{value:.4g}"
    else:
        digits = 1 - math.floor(math.log10(std))
        text = f"{round(value, digits):.{max(0, digits)}f}"
    return text.replace("-", MINUS)


def plain(value: object) -> str:
    """Return any JSON value as one short line."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return short(value)
    if value is None:
        return DASH
    if isinstance(value, Quantity | ParameterValue):
        return with_std(value)
    if isinstance(value, Mapping):
        if {"value", "std"} <= value.keys():
            return with_std(value)
        return ", ".join(f"{key} {plain(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(plain(item) for item in value)
    return str(value)


def with_std(quantity: Quantity | ParameterValue | Mapping[str, Any]) -> str:
    """Return ``value ± std`` without its unit."""
    if not isinstance(quantity, Mapping):
        quantity = {"value": quantity.value, "std": quantity.std}
    value, std = float(quantity["value"]), quantity.get("std")
    if not std:
        return short(value)
    return f"{short(value, float(std))} ± {short(float(std), float(std))}"


def probability(value: float) -> str:
    """Return a probability in one form, however small."""
    # what is smaller says no more than that there is an effect: no law of the null holds there
    return "below 1e-9" if value < 1e-9 else f"{value:.1e}"


def unit_words(unit: str) -> str:
    """Return a unit as it is set on a page: ``N·m`` for ``N m``."""
    return unit.replace("N m", "N·m").replace("kg m^2", "kg·m²")


def first_up(text: str) -> str:
    """Return a text with a capital at its start and units as they are set on a page."""
    return unit_words(text[:1].upper() + text[1:])


def unit_of(parameter: ParameterValue) -> str:
    """Return the unit of a parameter; nothing for a pure number."""
    return "" if parameter.unit == "1" else parameter.unit


def stated(parameters: Mapping[str, ParameterValue]) -> dict[str, ParameterValue]:
    """Return parameters without cosine and sine parts of what has an amplitude."""
    waves = {name.removeprefix("amplitude") for name in parameters if name.startswith("amplitude")}
    parts = {f"{part}{rest}" for rest in waves for part in ("cosine", "sine")}
    return {name: value for name, value in parameters.items() if name not in parts}


def name_words(name: str) -> str:
    """Return the name of a parameter as words, without its unit."""
    for suffix in _UNIT_SUFFIXES:
        name = name.removesuffix(suffix)
    return name.replace("_", " ")


def parameter_words(name: str, parameter: ParameterValue) -> str:
    """Return a parameter as name, value and unit."""
    return f"{name_words(name)} {plain(parameter)} {unit_words(unit_of(parameter))}".strip()


def form(value: Any, form: str) -> str:
    """Return a number in the form of a format specification, a dash for none."""
    return DASH if value is None else format(value, form)


def declared(value: object) -> str:
    """Return a value as the record shows it; what is blank is not declared."""
    if value is None or value == "":
        return "not declared"
    return short(value) if isinstance(value, float) else str(value)


def fixed(value: object, digits: int, factor: float = 1.0) -> str:
    """Return a number times a factor with so many digits behind the point, a dash for none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return DASH
    # a zero has no sign
    return f"{round(factor * value, digits) + 0.0:.{digits}f}".replace("-", MINUS)


def percent(value: object, digits: int = 3) -> str:
    """Return a share in percent, a dash for none."""
    return fixed(value, digits, 100.0)


def ppm(value: object) -> str:
    """Return a share in millionths, a dash for none."""
    return fixed(value, 0, 1e6)


def millivolts(value: object) -> str:
    """Return a voltage, V, in millivolts, a dash for none."""
    return fixed(value, 2, 1e3)


def two_digits(value: float | None) -> str:
    """Return an uncertainty with two significant digits, a dash for none."""
    return short(value, value) if value and math.isfinite(value) else DASH


def rounded_with(value: float, expanded: float) -> tuple[str, str]:
    """Return a result and its expanded uncertainty, both to the second digit of the second."""
    return short(value, expanded), two_digits(expanded)


def extra_lines(result: MisalignmentResult | RippleResult) -> str:
    """Return each line and tone beside the known orders with its place and size."""
    words = [
        f"{with_std(x.amplitude_nm)} N·m at motor order {short(x.order)}" for x in result.lines
    ]
    words += [f"{with_std(x.amplitude_nm)} N·m at {short(x.frequency_hz)} Hz" for x in result.tones]
    return "; ".join(words)
