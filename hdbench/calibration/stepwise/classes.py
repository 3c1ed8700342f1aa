"""Indicative classes in the manner of EURAMET cg-14."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["CLASSES", "Classification", "Criterion", "class_limit", "classify"]

CLASSES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
# limit of each criterion in a class c, share of the deflection: c/2 %, c %, c/4 %, c/2 %, 1.25 c %;
# of the applied torque (k = 2): c/5 %. The published table rounds two of them upwards.
_FACTORS = {
    "repeatability": 0.5,
    "reproducibility": 1.0,
    "zero": 0.25,
    "fit": 0.5,
    "reversibility": 1.25,
    "torque": 0.2,
}
_ROUNDED = {("reversibility", 0.05): 0.063e-2, ("reversibility", 0.5): 0.63e-2}
# smallest torque over resolution in class c is 200/c
_RESOLUTION_STEPS = 200.0
# limits and values are decimal fractions: equality up to rounding is within the limit
_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True)
class Criterion:
    """One criterion and the class that it allows.

    Parameters
    ----------
    name : str
        ``repeatability``, ``reproducibility``, ``zero``, ``fit``, ``reversibility``, ``torque``
        or ``resolution``.
    value : float
        Largest relative value over all steps; for ``resolution`` the smallest step over it.
    allowed : float or None
        Class; None: outside the worst.
    limit : float
        Limit of that class, or of the worst.
    """

    name: str
    value: float
    allowed: float | None
    limit: float

    def to_dict(self) -> dict[str, object]:
        """Return the criterion as results store it."""
        return {
            "name": self.name,
            "value": self.value,
            "class": self.allowed,
            "limit": self.limit,
        }


@dataclass(frozen=True, slots=True)
class Classification:
    """The class that all criteria allow.

    Parameters
    ----------
    value : float or None
        Class; None where a criterion is outside the worst, or reproducibility is not known.
    reason : str
        What sets it, or why there is none.
    criteria : tuple of Criterion
        All that could be tested.
    missing : tuple of str
        Criteria for which there are no data.
    """

    value: float | None
    reason: str
    criteria: tuple[Criterion, ...]
    missing: tuple[str, ...]

    def to_dict(self) -> dict[str, object]:
        """Return the classification as results store it."""
        return {
            "class": self.value,
            "reason": self.reason,
            "criteria": [c.to_dict() for c in self.criteria],
            "missing": list(self.missing),
        }


def class_limit(name: str, grade: float) -> float:
    """Return the limit of a criterion in a class.

    Parameters
    ----------
    name : str
        Criterion.
    grade : float
        Class, one of `CLASSES`.

    Returns
    -------
    float
        Share of the deflection (of that at the largest torque for ``zero``); for ``resolution``
        the least number of resolution steps in the smallest torque.

    References
    ----------
    .. [1] In the manner of EURAMET cg-14 v2.0 (2011) and DIN 51309; not checked against the text.
    """
    if name == "resolution":
        return _RESOLUTION_STEPS / grade
    return _ROUNDED.get((name, grade), _FACTORS[name] * grade * 1e-2)


def _criterion(name: str, value: float) -> Criterion:
    for grade in CLASSES:
        limit = class_limit(name, grade)
        held = value >= limit if name == "resolution" else value <= limit * (1.0 + _ROUNDING)
        if held:
            return Criterion(name, value, grade, limit)
    return Criterion(name, value, None, class_limit(name, CLASSES[-1]))


def classify(values: dict[str, float | None], needed: Sequence[str]) -> Classification:
    """Return the class that the values allow."""
    known = {n: v for n, v in values.items() if v is not None and math.isfinite(v)}
    criteria = tuple(_criterion(name, value) for name, value in known.items())
    missing = tuple(name for name in values if name not in known)
    absent = [name for name in needed if name not in known]
    if absent:
        reason = f"no data for {', '.join(absent)}"
        return Classification(None, reason, criteria, missing)
    outside = [c.name for c in criteria if c.allowed is None]
    if outside:
        reason = f"{', '.join(outside)} outside class {CLASSES[-1]:g}"
        return Classification(None, reason, criteria, missing)
    worst = max(c.allowed or 0.0 for c in criteria)
    setting = ", ".join(c.name for c in criteria if c.allowed == worst)
    without = f"; no data for {', '.join(missing)}" if missing else ""
    return Classification(worst, f"set by {setting}{without}", criteria, missing)
