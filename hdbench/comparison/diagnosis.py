"""Two diagnoses: causes of one only, and parameters of those of both."""

from __future__ import annotations

from hdbench.comparison.dynamic import Moved
from hdbench.comparison.score import Terms, compared
from hdbench.records import Quantity
from hdbench.results import DiagnosisResult


def compare_diagnoses(a: DiagnosisResult, b: DiagnosisResult, terms: Terms) -> Moved:
    """Compare two diagnoses: causes of one only, and parameters of those of both."""
    first, second = ({cause.name: cause for cause in one.causes} for one in (a, b))
    rows = []
    for name in sorted(first.keys() & second.keys()):
        one, other = first[name].parameters, second[name].parameters
        for key in sorted(one.keys() & other.keys()):
            x, y = one[key], other[key]
            # what has no uncertainty cannot be held against anything
            if x.std is not None and y.std is not None:
                named = (f"{name}.{key}", f"{name}, {key}", "" if x.unit == "1" else x.unit)
                rows.append((named, Quantity(x.value, x.std), Quantity(y.value, y.std)))
    level = terms.level(len(rows))
    found = tuple(compared(named, x, y, confidence=level, decides=True) for named, x, y in rows)
    return Moved(
        found,
        "parameters taken as independent",
        only_a=tuple(sorted(first.keys() - second.keys())),
        only_b=tuple(sorted(second.keys() - first.keys())),
    )
