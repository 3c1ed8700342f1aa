"""What differs in how two results came about: profile keys, versions, device, calibration."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hdbench.comparison.side import Side
from hdbench.results.flatten import Leaf, flatten

__all__ = ["KeyChange", "environment_changes", "profile_changes"]

_ABOUT = ("hdbench_version", "versions", "device", "host", "calibration", "status")
# what a run says of one calibration and its age is told by the calibration's hash already
_LEFT_OUT = ("calibration.age_days", "calibration.age_words")


@dataclass(frozen=True, slots=True)
class KeyChange:
    """One key that is not the same in both.

    Parameters
    ----------
    key : str
        Its path.
    a, b : number, text, bool or None
        Its values; None also where it is absent, see `only`.
    only : str
        ``a`` or ``b`` where the other one lacks it, else empty.
    """

    key: str
    a: Leaf
    b: Leaf
    only: str = ""


def _differences(a: Mapping[str, Leaf], b: Mapping[str, Leaf]) -> tuple[KeyChange, ...]:
    changes = []
    for key in sorted(a.keys() | b.keys()):
        only = "" if key in a and key in b else "a" if key in a else "b"
        if only or a[key] != b[key]:
            changes.append(KeyChange(key, a.get(key), b.get(key), only))
    return tuple(changes)


def profile_changes(a: Side, b: Side) -> tuple[KeyChange, ...] | None:
    """Return the profile keys that differ, as the profiles were written."""
    if a.profile is None or b.profile is None:
        return None
    texts = [tomllib.loads(side.profile.text) for side in (a, b) if side.profile is not None]
    return _differences(flatten(_plain(texts[0])), flatten(_plain(texts[1])))


def _plain(body: Any) -> Any:
    """Return a TOML value with dates as text."""
    if isinstance(body, Mapping):
        return {key: _plain(value) for key, value in body.items()}
    if isinstance(body, list):
        return [_plain(value) for value in body]
    return body if isinstance(body, str | int | float | bool) else str(body)


def environment_changes(a: Side, b: Side) -> tuple[KeyChange, ...] | None:
    """Return what else differs: versions, device, host, calibration, evaluation."""
    if not (a.manifest and b.manifest):
        return None
    first, second = (
        {
            key: leaf
            for key, leaf in flatten(
                {name: side.manifest[name] for name in _ABOUT if name in side.manifest}
            ).items()
            if key not in _LEFT_OUT
        }
        for side in (a, b)
    )
    return _differences(first, second)
