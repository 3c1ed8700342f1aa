"""Key numbers out of results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from hdbench.report.elements import KeyNumber

__all__ = ["key_number", "key_numbers", "value_of"]


def value_of(result: Mapping[str, Any], *keys: str) -> float | None:
    """Return a number deep in a result, the value of one with uncertainty, or None."""
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
    """Return a key number from a result's entry."""
    std = dof = None
    if isinstance(body, Mapping):
        std, dof, body = body.get("std"), body.get("dof"), body.get("value")
    if isinstance(body, bool) or not isinstance(body, int | float):
        return None
    return KeyNumber(label, quantity, float(body), unit, source, std, dof, note)


def key_numbers(rows: Iterable[tuple[Any, str, str, str]], run_id: str) -> tuple[KeyNumber, ...]:
    """Return the key numbers of a run, without those that its result does not hold."""
    made = (
        key_number(body, label, key, unit, f"{run_id}: {key}") for body, label, key, unit in rows
    )
    return tuple(number for number in made if number is not None)
