"""Changes of a result against an expected one, each held against a tolerance with its reason."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from hdbench.results import Part
from hdbench.results.parts import Leaf, flatten

_Size = Annotated[float, Field(strict=True, ge=0.0)]


class Tolerance(Part, kw_only=False, closed=True):
    """How far the quantities of one path pattern may move.

    Parameters
    ----------
    pattern : str
        Path; ``*`` stands for any text. Everything else is taken literally.
    reason : str
        Why it may move as far and no farther.
    abs : float
        Absolute, unit of the quantity, at least 0.
    rel : float
        Share of the expected value, at least 0.
    sigma : float
        In standard uncertainties of the expected value, at least 0; for a ``value`` that has a
        ``std`` beside it.
    note_only : bool
        True where a change is told but is no regression.
    """

    pattern: str
    reason: Annotated[str, Field(pattern=r"\S")]
    abs: _Size = 0.0
    rel: _Size = 0.0
    sigma: _Size = 0.0
    note_only: Annotated[bool, Field(strict=True)] = False

    def matches(self, path: str) -> bool:
        """Return whether a path is one of the pattern's."""
        parts = (re.escape(part) for part in self.pattern.split("*"))
        return re.fullmatch(".*".join(parts), path) is not None

    def allowed(self, expected: float, std: float | None) -> float:
        """Return the largest change that is no regression, unit of the quantity."""
        by_std = self.sigma * std if std is not None else 0.0
        return max(self.abs, self.rel * abs(expected), by_std)


def read_tolerances(
    body: Mapping[str, Mapping[str, object]], where: str, fix: str
) -> tuple[Tolerance, ...]:
    """Return the tolerances of a file, in its order."""
    return tuple(
        Tolerance.from_json({"pattern": pattern, **item}, f"{where}[{pattern!r}]", fix)
        for pattern, item in body.items()
    )


@cache
def _defaults() -> tuple[Tolerance, ...]:
    file = Path(__file__).with_name("tolerances.toml")
    return read_tolerances(tomllib.loads(file.read_text(encoding="utf-8")), str(file), "")


def tolerance_for(path: str, own: tuple[Tolerance, ...]) -> Tolerance:
    """Return the tolerance of one quantity: the first that matches, those of its case first."""
    return next(rule for rule in (*own, *_defaults()) if rule.matches(path))


@dataclass(frozen=True, slots=True)
class Change:
    """One quantity that is not what it was.

    Parameters
    ----------
    key : str
        Its path in the result.
    what : {"moved", "changed", "missing", "new"}
        A number moved; another value changed; the key is gone; the key was not there before.
    expected, found : number, text, bool or None
        Before and now.
    allowed : float or None
        How far it may move, unit of the quantity; None for what is no number.
    in_tolerances : float or None
        How far it moved, in units of `allowed`; None where that is 0 or no number.
    reason : str
        Why the tolerance is what it is.
    regression : bool
        False where the change is told but allowed.
    """

    key: str
    what: Literal["moved", "changed", "missing", "new"]
    expected: Leaf
    found: Leaf
    allowed: float | None
    in_tolerances: float | None
    reason: str
    regression: bool

    def describe(self) -> str:
        """Return the change as one line for a person."""
        if self.what == "missing":
            return f"{self.key}: missing, was {self.expected!r}"
        if self.what == "new":
            return f"{self.key}: new, {self.found!r}"
        line = f"{self.key}: {self.expected!r} -> {self.found!r}"
        if self.in_tolerances is not None:
            return f"{line}, {self.in_tolerances:.3g} times its tolerance of {self.allowed:.3g}"
        return line


def compare_results(
    expected: Mapping[str, Any], found: Mapping[str, Any], own: tuple[Tolerance, ...] = ()
) -> tuple[tuple[Change, ...], int]:
    """Compare two results quantity by quantity.

    Parameters
    ----------
    expected, found : mapping
        Results before and now.
    own : tuple of Tolerance
        Tolerances that stand before the defaults.

    Returns
    -------
    changes : tuple of Change
        Regressions first, the farthest moved first among them.
    compared : int
        How many quantities are in both.
    """
    before, now = flatten(expected), flatten(found)
    changes = [
        change
        for key in before.keys() & now.keys()
        if (change := _compare(key, before, now[key], own)) is not None
    ]
    for key in before.keys() - now.keys():
        rule = tolerance_for(key, own)
        changes.append(
            Change(key, "missing", before[key], None, None, None, rule.reason, not rule.note_only)
        )
    changes += [
        Change(key, "new", None, now[key], None, None, "keys may be added", False)
        for key in now.keys() - before.keys()
    ]
    changes.sort(key=_rank)
    return tuple(changes), len(before.keys() & now.keys())


def _rank(change: Change) -> tuple[bool, float, str]:
    far = math.inf if change.in_tolerances is None else change.in_tolerances
    return not change.regression, -far, change.key


def _number(value: Leaf) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value)


def _compare(
    key: str, before: Mapping[str, Leaf], found: Leaf, own: tuple[Tolerance, ...]
) -> Change | None:
    rule, expected = tolerance_for(key, own), before[key]
    old, new = _number(expected), _number(found)
    if old is None or new is None:
        if expected == found and type(expected) is type(found):
            return None
        regression = not rule.note_only
        return Change(key, "changed", expected, found, None, None, rule.reason, regression)
    std = before.get(f"{key.removesuffix('.value')}.std") if key.endswith(".value") else None
    allowed = rule.allowed(old, _number(std))
    distance = abs(new - old)
    if "phase_rad" in key and not key.endswith(".std"):
        distance = abs(math.remainder(new - old, 2.0 * math.pi))
    if distance <= allowed:
        return None
    share = distance / allowed if allowed > 0.0 else None
    return Change(key, "moved", expected, found, allowed, share, rule.reason, not rule.note_only)
