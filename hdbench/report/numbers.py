"""Numbers as a person reads them, and key numbers out of results."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from hdbench.report.elements import KeyNumber

__all__ = [
    "DASH",
    "MINUS",
    "key_number",
    "plain",
    "probability",
    "short",
    "unit_words",
    "value_of",
    "with_std",
]

MINUS, DASH = "\N{MINUS SIGN}", "\N{EN DASH}"


def short(value: float, std: float | None = None) -> str:
    """Return a number with as many digits as its uncertainty allows.

    Parameters
    ----------
    value : float
        The number.
    std : float or None
        Its standard uncertainty, same unit; None or 0 gives four significant digits.

    Returns
    -------
    str
        With a true minus sign.

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
    """Return any JSON value as one short line.

    Parameters
    ----------
    value : object
        Number, text, boolean, None, list or mapping.

    Returns
    -------
    str
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return short(value)
    if value is None:
        return DASH
    if isinstance(value, Mapping):
        if {"value", "std"} <= value.keys():
            return with_std(value)
        return ", ".join(f"{key} {plain(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(plain(item) for item in value)
    return str(value)


def with_std(quantity: Mapping[str, Any]) -> str:
    """Return ``value ± std`` without its unit.

    Parameters
    ----------
    quantity : mapping
        With ``value`` and ``std``.

    Returns
    -------
    str
    """
    value, std = float(quantity["value"]), quantity.get("std")
    if not std:
        return short(value)
    return f"{short(value, float(std))} ± {short(float(std), float(std))}"


def probability(value: Any) -> str:
    """Return a probability in one form, however small.

    Parameters
    ----------
    value : float or None
        Probability, in [0, 1].

    Returns
    -------
    str
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        return DASH
    # the smallest double that keeps its digits
    return "below 1e-300" if value < 1e-300 else f"{value:.1e}"


def unit_words(unit: str) -> str:
    """Return a unit as it is set on a page: ``N·m`` for ``N m``.

    Parameters
    ----------
    unit : str
        As results write it.

    Returns
    -------
    str
    """
    return unit.replace("N m", "N·m")


def value_of(result: Mapping[str, Any], *keys: str) -> float | None:
    """Return a number deep in a result, the value of one with uncertainty, or None.

    Parameters
    ----------
    result : mapping
        A result.
    *keys : str
        Path to the number.

    Returns
    -------
    float or None
    """
    found: Any = result
    for key in keys:
        if not isinstance(found, Mapping) or key not in found:
            return None
        found = found[key]
    if isinstance(found, Mapping):
        found = found.get("value")
    return float(found) if isinstance(found, int | float) and not isinstance(found, bool) else None


def key_number(
    body: Any, label: str, quantity: str, unit: str, source: str, *, note: str = ""
) -> KeyNumber | None:
    """Return a key number from a result's entry.

    Parameters
    ----------
    body : object
        A number, a mapping with `value`, `std`, `dof`, or None.
    label : str
        Name for a person.
    quantity : str
        Name for a program.
    unit : str
        Unit.
    source : str
        Where it stands.
    note : str
        What to know beside it.

    Returns
    -------
    KeyNumber or None
        None where there is no number.
    """
    std = dof = None
    if isinstance(body, Mapping):
        std, dof, body = body.get("std"), body.get("dof"), body.get("value")
    if isinstance(body, bool) or not isinstance(body, int | float):
        return None
    return KeyNumber(label, quantity, float(body), unit, source, std, dof, note)
