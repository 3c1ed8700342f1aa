"""Tolerances of quantities, each with its reason."""

from __future__ import annotations

import re
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


def tolerance_for(path: str, own: tuple[Tolerance, ...]) -> Tolerance:
    """Return the tolerance of one quantity."""
    return next(rule for rule in (*own, *DEFAULTS) if rule.matches(path))
