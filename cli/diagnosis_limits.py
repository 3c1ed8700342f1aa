"""Limits of a diagnosis in words: samples that took no part, what is left, names not testable."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["left_out_line", "names_line", "rest_line"]

# a rest within 5 % of the noise is within what its two estimates differ by
_ABOVE = 1.05
# names of one reason, and characters of all, that are written out: three lines of 80
_NAMES = 2
_LONGEST = 210


def left_out_line(result: Mapping[str, Any]) -> str:
    """Say how many samples took no part and why; nothing where all did."""
    left = [one for one in result.get("left_out") or () if one["samples"]]
    if not left:
        return ""
    total = round(left[0]["samples"] / left[0]["share"])
    samples = sum(one["samples"] for one in left)
    if len(left) == 1:
        why = left[0]["reason"]
    else:
        why = ", ".join(f"{one['reason']} ({_count(one['samples'])})" for one in left)
    share = f"{100.0 * samples / total:.2g} %"
    return f"{_count(samples)} of {_count(total)} samples ({share}): {why}"


def rest_line(result: Mapping[str, Any]) -> str:
    """Say what the model leaves above the noise and where; nothing where it leaves noise."""
    rest = result.get("rest")
    if not rest or not rest["heldout_rms_nm"] > _ABOVE * rest["noise_rms_nm"]:
        return ""
    axes = [
        " and ".join(x for x in (one["domain"], one.get("second_domain")) if x)
        for one in rest["told"]
    ]
    where = f"unexplained at {', '.join(dict.fromkeys(axes))}" if axes else "not located"
    return (
        f"{rest['heldout_rms_nm']:.3g} N m left in noise of {rest['noise_rms_nm']:.3g} N m: {where}"
    )


def names_line(result: Mapping[str, Any], room: int | None = None) -> str:
    """Say how many names of the catalogue this record can show, and why not the others.

    With a room, in characters, reasons stand with counts instead of names, as many as fit.
    """
    names = result.get("testable") or ()
    hidden: dict[str, list[str]] = {}
    for one in names:
        if not one["testable"]:
            # what stands behind a semicolon is of this name alone
            hidden.setdefault(one["because"].partition(";")[0], []).append(one["name"])
    count = sum(len(group) for group in hidden.values())
    told = f"{len(names) - count} of {len(names)} names" if names else ""
    if room is None and names:
        told += " can be tested here"
    lead, shown = "; not: ", 0
    for reason, group in sorted(hidden.items(), key=lambda item: -len(item[1])):
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


def _count(number: int) -> str:
    """Return a whole number in groups of three digits."""
    return f"{number:,}".replace(",", " ") if number > 9999 else str(number)
