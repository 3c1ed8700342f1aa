"""Two diagnoses: causes of one only, and parameters of those of both."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.regression.comparison.moved import Moved
from hdbench.regression.comparison.score import compared
from hdbench.regression.comparison.side import Side, quantity

__all__ = ["compare_diagnoses"]


def _causes(side: Side) -> dict[str, Mapping[str, Any]]:
    causes = side.result.get("causes")
    return {
        str(cause.get("name")): cause
        for cause in (causes if isinstance(causes, list) else ())
        if isinstance(cause, Mapping)
    }


def compare_diagnoses(a: Side, b: Side, *, confidence: float = 0.95) -> Moved:
    """Compare two diagnoses: causes of one only, and parameters of those of both."""
    first, second = _causes(a), _causes(b)
    rows = []
    for name in sorted(first.keys() & second.keys()):
        parameters = [cause.get("parameters") or {} for cause in (first[name], second[name])]
        for key in sorted(parameters[0].keys() & parameters[1].keys()):
            bodies = [p[key] for p in parameters]
            values = [quantity(x, f"{a.where}: causes.{name}.{key}") for x in bodies]
            if values[0] is not None and values[1] is not None:
                unit = str(bodies[0].get("unit") or "")
                named = (f"{name}.{key}", f"{name}, {key}", "" if unit == "1" else unit)
                rows.append((named, values[0], values[1]))
    level = 1.0 - (1.0 - confidence) / max(1, len(rows))
    found = tuple(compared(named, x, y, confidence=level, decides=True) for named, x, y in rows)
    return Moved(
        found,
        only_a=tuple(sorted(first.keys() - second.keys())),
        only_b=tuple(sorted(second.keys() - first.keys())),
    )
