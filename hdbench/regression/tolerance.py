"""Tolerances of quantities, each with its reason."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated

from pydantic import Field

from hdbench.results import Part

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
