"""How far a quantity may move, and why."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hdbench.errors import DataError

__all__ = ["DEFAULTS", "Tolerance", "read_tolerances", "tolerance_for"]


@dataclass(frozen=True, slots=True)
class Tolerance:
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
    reason: str
    abs: float = 0.0
    rel: float = 0.0
    sigma: float = 0.0
    note_only: bool = False

    def matches(self, path: str) -> bool:
        """Return whether a path is one of the pattern's."""
        parts = (re.escape(part) for part in self.pattern.split("*"))
        return re.fullmatch(".*".join(parts), path) is not None

    def allowed(self, expected: float, std: float | None) -> float:
        """Return the largest change that is no regression, unit of the quantity."""
        by_std = self.sigma * std if std is not None else 0.0
        return max(self.abs, self.rel * abs(expected), by_std)


# the first pattern that matches counts; those of a case stand before these
DEFAULTS = (
    Tolerance(
        "*sha256*",
        "a hash tells that bits moved, as they may between processors; the numbers beside it "
        "tell by how much",
        note_only=True,
    ),
    Tolerance("*reason", "words for a person, not a result", note_only=True),
    Tolerance("*detail", "words for a person, not a result", note_only=True),
    Tolerance("*origin", "words for a person, not a result", note_only=True),
    Tolerance("torque_scale.source", "words for a person; the gain is compared", note_only=True),
    Tolerance(
        "*false_alarm_probability",
        "a tail probability: a tenth of it decides nothing",
        abs=1e-12,
        rel=0.1,
    ),
    Tolerance("noise.*", "the noise model is found by iteration to a stopping rule", rel=1e-2),
    Tolerance(
        "*process_noise", "taken from the noise model, which is found by iteration", rel=1e-2
    ),
    Tolerance(
        "*.std",
        "an uncertainty is itself known to some per cent; noise model by iteration",
        abs=1e-12,
        rel=1e-2,
    ),
    Tolerance("*dof", "effective degrees of freedom rest on the noise model", rel=5e-2),
    Tolerance(
        "*suppression_db",
        "the amplitude that is left is near the noise; a tenth of a decibel is 1 % of it",
        abs=0.1,
    ),
    Tolerance(
        "*.value",
        "a fiftieth of its own standard uncertainty: below what any use of it could notice, above "
        "what another version of a linear-algebra library changes",
        abs=1e-12,
        rel=1e-9,
        sigma=0.02,
    ),
    Tolerance(
        "samples_nm*",
        "the filter's forms agree to 1e-9 N m: rounding of a recursion with unit-norm rotations",
        abs=1e-9,
    ),
    Tolerance(
        "*",
        "double rounding 2.2e-16 amplified by least squares of condition below 1e6",
        abs=1e-12,
        rel=1e-8,
    ),
)

_NUMBERS = ("abs", "rel", "sigma")


def read_tolerances(body: Any, where: str) -> tuple[Tolerance, ...]:
    """Read the tolerances of a case."""
    if body is None:
        return ()
    if not isinstance(body, Mapping):
        raise _bad(f"tolerances is a {type(body).__name__}; needed: an object", where)
    return tuple(_read_one(pattern, item, where) for pattern, item in body.items())


def _read_one(pattern: str, item: Any, where: str) -> Tolerance:
    place = f"{where}: tolerances[{pattern!r}]"
    if not isinstance(item, Mapping):
        raise _bad(f"found a {type(item).__name__}; needed: an object", place)
    unknown = set(item) - {*_NUMBERS, "note_only", "reason"}
    if unknown:
        raise _bad(
            f"unknown key {min(unknown)!r}; known: abs, rel, sigma, note_only, reason", place
        )
    reason = item.get("reason")
    if not (isinstance(reason, str) and reason.strip()):
        raise _bad("reason is missing; needed: why this quantity may move as far", place)
    sizes = {}
    for name in _NUMBERS:
        value = item.get(name, 0.0)
        good = isinstance(value, int | float) and not isinstance(value, bool)
        if not (good and 0.0 <= value < math.inf):
            raise _bad(f"{name} is {value!r}; needed: a finite number of at least 0", place)
        sizes[name] = float(value)
    note_only = item.get("note_only", False)
    if not isinstance(note_only, bool):
        raise _bad(f"note_only is {note_only!r}; needed: true or false", place)
    return Tolerance(pattern, reason, **sizes, note_only=note_only)


def _bad(what: str, where: str) -> DataError:
    return DataError(what, where=where, fix="correct the case file")


def tolerance_for(path: str, own: tuple[Tolerance, ...]) -> Tolerance:
    """Return the tolerance of one quantity."""
    return next(rule for rule in (*own, *DEFAULTS) if rule.matches(path))
