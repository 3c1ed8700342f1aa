"""Names that a record can show, and why not the others, on one to three lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.report.diagnosis.limits import hidden_names

__all__ = ["names_line"]

# names of one reason, and characters of all, that are written out: three lines of 80
_NAMES = 2
_LONGEST = 210


def names_line(result: Mapping[str, Any], room: int | None = None) -> str:
    """Say how many names of the catalogue this record can show, and why not the others.

    With a room, in characters, reasons stand with counts instead of names, as many as fit.
    """
    names = result.get("testable") or ()
    hidden = hidden_names(result)
    count = sum(len(group) for group in hidden.values())
    told = f"{len(names) - count} of {len(names)} names" if names else ""
    if room is None and names:
        told += " can be tested here"
    lead, shown = "; not: ", 0
    for reason, group in hidden.items():
        words = _few(group) if room is None else str(len(group))
        longer = f"{told}{lead}{words} ({reason})"
        if len(longer) > (_LONGEST if room is None else room - len("; 99 more")):
            break
        told, lead, shown = longer, "; ", shown + len(group)
    return told if shown == count else f"{told}{lead}{count - shown} more"


def _few(names: list[str]) -> str:
    """Return the first names and how many follow."""
    if len(names) <= _NAMES + 1:
        return ", ".join(names)
    return f"{', '.join(names[:_NAMES])} and {len(names) - _NAMES} more"
