"""One quantity of two results, and how far it moved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hdbench.records import Quantity

__all__ = ["Compared"]


@dataclass(frozen=True, slots=True)
class Compared:
    """One quantity of both results.

    Parameters
    ----------
    name : str
        Key, for a program.
    label : str
        Name, for a person.
    unit : str
        Unit; empty for a pure number.
    a, b : Quantity or float or None
        The two; a float where no uncertainty is declared, None where one side has none.
    difference : Quantity or None
        b less a.
    coverage_factor : float or None
        k for the confidence and the degrees of freedom of the difference.
    score : float or None
        Size of the difference over its expanded uncertainty; above 1 it has moved. None where it
        has no uncertainty.
    correlation : float
        Correlation of the two, from what they have in common.
    decides : bool
        Whether the verdict rests on it.
    note : str
        What to know beside it.
    """

    name: str
    label: str
    unit: str
    a: Quantity | float | None
    b: Quantity | float | None
    difference: Quantity | None = None
    coverage_factor: float | None = None
    score: float | None = None
    correlation: float = 0.0
    decides: bool = False
    note: str = ""

    @property
    def moved(self) -> bool | None:
        """Whether it moved beyond its uncertainty; None where that cannot be told."""
        return None if self.score is None else not self.score <= 1.0

    @property
    def expanded(self) -> float | None:
        """Expanded uncertainty of the difference, unit of the quantity."""
        if self.difference is None or self.coverage_factor is None:
            return None
        return self.coverage_factor * self.difference.std

    def to_dict(self) -> dict[str, Any]:
        """Return it as ``--json`` prints it."""
        change = _relative(self.a, self.b)
        return {
            "name": self.name,
            "label": self.label,
            "unit": self.unit,
            "a": _plain(self.a),
            "b": _plain(self.b),
            "difference": None if self.difference is None else self.difference.to_dict(),
            "relative_change": change,
            "expanded": self.expanded,
            "coverage_factor": self.coverage_factor,
            "score": self.score,
            "moved": self.moved,
            "correlation": self.correlation,
            "decides": self.decides,
            "note": self.note,
        }


def _plain(body: Quantity | float | None) -> object:
    return body.to_dict() if isinstance(body, Quantity) else body


def _value(body: Quantity | float | None) -> float | None:
    return body.value if isinstance(body, Quantity) else body


def _relative(a: Quantity | float | None, b: Quantity | float | None) -> float | None:
    first, second = _value(a), _value(b)
    if first is None or second is None or first == 0.0:
        return None
    return second / first - 1.0
