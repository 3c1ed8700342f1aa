"""Two diagnoses: causes of one only, and parameters of those of both."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.comparison.dynamic import Moved
from hdbench.comparison.score import compared
from hdbench.comparison.side import Side
from hdbench.errors import DataError
from hdbench.records import Quantity


def _causes(side: Side) -> dict[str, Mapping[str, Any]]:
    causes = side.body.get("causes")
    return {
        str(cause.get("name")): cause
        for cause in (causes if isinstance(causes, list) else ())
        if isinstance(cause, Mapping)
    }


def compare_diagnoses(a: Side, b: Side, *, confidence: float) -> Moved:
    """Compare two diagnoses: causes of one only, and parameters of those of both."""
    first, second = _causes(a), _causes(b)
    rows = []
    for name in sorted(first.keys() & second.keys()):
        parameters = [cause.get("parameters") or {} for cause in (first[name], second[name])]
        for key in sorted(parameters[0].keys() & parameters[1].keys()):
            bodies = [p[key] for p in parameters]
            values = [_quantity(x, f"{a.where}: causes.{name}.{key}") for x in bodies]
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


def _quantity(body: Any, where: str) -> Quantity | None:
    """Return a number with its uncertainty, or None where there is none."""
    if body is None:
        return None
    try:
        return Quantity(float(body["value"]), float(body["std"]), body.get("dof"))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise DataError(
            f"found {body!r:.60}; needed: an object with value, std and dof",
            where=where,
            fix="evaluate the run again with --from",
        ) from error
