"""Indicative classes in the manner of EURAMET cg-14."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hdbench.results.calibration import Classification, Criterion, LoadGroup

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


def class_limit(name: str, grade: float) -> float:
    """Return the limit of a criterion in a class.

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
            return Criterion(name=name, value=value, allowed=grade, limit=limit)
    limit = class_limit(name, CLASSES[-1])
    return Criterion(name=name, value=value, allowed=None, limit=limit)


def classify(values: dict[str, float | None], needed: Sequence[str]) -> Classification:
    """Return the class that the values allow."""
    known = {n: v for n, v in values.items() if v is not None and math.isfinite(v)}
    criteria = tuple(_criterion(name, value) for name, value in known.items())
    missing = tuple(name for name in values if name not in known)
    absent = [name for name in needed if name not in known]
    outside = [c.name for c in criteria if c.allowed is None]
    value = None
    if absent:
        reason = f"no data for {', '.join(absent)}"
    elif outside:
        reason = f"{', '.join(outside)} outside class {CLASSES[-1]:g}"
    else:
        value = max(c.allowed or 0.0 for c in criteria)
        setting = ", ".join(c.name for c in criteria if c.allowed == value)
        without = f"; no data for {', '.join(missing)}" if missing else ""
        reason = f"set by {setting}{without}"
    return Classification(value=value, reason=reason, criteria=criteria, missing=missing)


def overall_class(groups: Sequence[LoadGroup]) -> Classification:
    """Return the worst class of the directions of the widest range."""
    if not groups:
        return Classification(value=None, reason="nothing was loaded")
    chosen = [group_class(group) for group in groups if group.range == groups[0].range]
    for one in chosen:
        if one.value is None:
            return one
    return max(chosen, key=lambda one: one.value or 0.0)


def group_class(group: LoadGroup) -> Classification:
    """Return the class of one group: with reversibility where it was unloaded, too."""
    unloaded = group.linear_up_down_v_per_nm is not None
    found = group.class_increasing_decreasing if unloaded else group.class_increasing
    if found is None:
        raise ValueError(f"the group {group.direction}, {group.range} range has no class")
    return found
