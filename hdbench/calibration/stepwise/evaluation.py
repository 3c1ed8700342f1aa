"""One group of series: quantities, uncertainty and class of each step."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hdbench.calibration.lever import TorqueAccount, relative_std
from hdbench.calibration.lines import series_lack_of_fit
from hdbench.calibration.stepwise.quantities import (
    StepQuantities,
    case_one,
    case_two,
    step_quantities,
)
from hdbench.calibration.stepwise.series import LoadSeries, StepGroup
from hdbench.records.trace import FloatArray
from hdbench.results.calibration import (
    Classification,
    Criterion,
    GroupSeries,
    LoadGroup,
    LoadStep,
    StepUncertainty,
)

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


def evaluate_group(
    group: StepGroup, account: TorqueAccount, resolution_v: float | None
) -> tuple[LoadGroup, tuple[LoadStep, ...]]:
    """Evaluate one group in the manner of EURAMET cg-14."""
    found, torque = step_quantities(group), group.torque_nm
    relative = np.array([account.relative_std_at(float(t)) for t in torque])
    one = case_one(found, torque, relative, resolution_v)
    two = case_two(found, torque, relative, resolution_v)
    first, second = _class_values(found, torque, account, resolution_v)
    needed, top = ("reproducibility",), float(torque[-1])
    sensitivity = float(found.mean_v[-1]) / top
    whole = LoadGroup(
        direction=group.direction,
        range=group.range,
        loading=group.loading,
        arm_length_m=group.arm_length_m,
        n_positions=found.n_positions,
        n_series=len(group.series),
        n_series_up_down=found.n_both,
        largest_torque_nm=top,
        sensitivity_v_per_nm=_known(sensitivity),
        gain_nm_per_v=_over(sensitivity),
        gain_up_nm_per_v=_over(found.linear),
        gain_up_down_nm_per_v=_over(found.linear_both),
        linear_v_per_nm=_known(found.linear),
        linear_up_down_v_per_nm=_known(found.linear_both),
        cubic_v=None if found.cubic is None else tuple(found.cubic.tolist()),
        zero_v=found.zero_v,
        zero_relative=_known(found.zero_v, over=found.full_v),
        resolution_v=resolution_v,
        class_increasing=classify(first, needed),
        class_increasing_decreasing=classify(second, (*needed, "reversibility")),
        zero_by_line=tuple(s.id for s in group.series if s.zero_by_line),
        torque_nm=tuple(torque.tolist()),
        series=tuple(_series(s) for s in group.series),
        lack_of_fit=series_lack_of_fit(torque, np.vstack([s.up_v for s in group.series])),
    )
    steps = [
        _step(group, found, k, one[k], None if two is None else two[k]) for k in range(len(torque))
    ]
    return whole, tuple(steps)


def _step(
    group: StepGroup,
    found: StepQuantities,
    k: int,
    one: StepUncertainty | None,
    two: StepUncertainty | None,
) -> LoadStep:
    torque, y = float(group.torque_nm[k]), float(found.mean_v[k])
    both = None if found.mean_both_v is None else float(found.mean_both_v[k])
    cubic, slope = _cubic_at(found, torque), found.linear_both
    off = None if both is None or slope is None else both - slope * torque
    volts = {
        "repeatability": _at(found.repeatability_v, k),
        "reproducibility": _at(found.reproducibility_v, k),
        "range": _at(found.range_v, k),
        "reversibility": _at(found.reversibility_v, k),
        "deviation_linear": _known(y - found.linear * torque),
        "deviation_cubic": None if cubic is None else _known(y - cubic),
    }
    return LoadStep(
        direction=group.direction,
        range=group.range,
        loading=group.loading,
        arm_length_m=group.arm_length_m,
        torque_nm=torque,
        deflection_v=_known(y),
        deflection_up_down_v=both,
        fitted_v=_known(found.linear * torque),
        deviation_up_down_relative=_known(off, over=both or math.nan),
        increasing=one,
        increasing_decreasing=two,
        **{f"{name}_v": size for name, size in volts.items()},
        **{f"{name}_relative": _known(size, over=y) for name, size in volts.items()},
    )


def _class_values(
    found: StepQuantities,
    torque: FloatArray,
    account: TorqueAccount,
    resolution_v: float | None,
) -> tuple[dict[str, float | None], dict[str, float | None]]:
    """Return the largest relative values: for increasing torque, and with decreasing torque."""
    y, common = found.mean_v, relative_std(account.rows)
    cubic = [_cubic_at(found, float(t)) for t in torque]
    of_cubic = None if None in cubic else np.abs(y - np.array(cubic, dtype=float))
    shared = {
        "repeatability": _largest(found.repeatability_v, y),
        "reproducibility": _largest(found.reproducibility_v, y),
        "zero": _known(found.zero_v, over=found.full_v),
        "torque": 2.0 * common if common > 0.0 else None,
        "resolution": None if resolution_v is None else _known(abs(float(y[0])), over=resolution_v),
    }
    line = None
    if found.mean_both_v is not None and found.linear_both is not None:
        line = _largest(found.mean_both_v - found.linear_both * torque, found.mean_both_v)
    reversible = _largest(found.reversibility_v, y)
    first = {**shared, "fit": _largest(of_cubic, y)}
    return first, {**shared, "fit": line, "reversibility": reversible}


def _largest(values: FloatArray | None, y: FloatArray) -> float | None:
    if values is None:
        return None
    relative = np.abs(values / np.where(y == 0.0, np.nan, y))
    return float(np.max(relative)) if np.isfinite(relative).all() else None


def _cubic_at(found: StepQuantities, torque: float) -> float | None:
    if found.cubic is None:
        return None
    a, b, c = (float(x) for x in found.cubic)
    return a * torque + b * torque**2 + c * torque**3


def _at(values: FloatArray | None, k: int) -> float | None:
    return None if values is None else _known(float(values[k]))


def _series(series: LoadSeries) -> GroupSeries:
    return GroupSeries(
        id=series.id,
        position_rad=series.position_rad,
        position=series.position,
        repeat=series.repeat,
        up_v=tuple(_known(float(v)) for v in series.up_v),
        down_v=tuple(_known(float(v)) for v in series.down_v),
        zero_before_v=series.zero_before_v,
        zero_after_v=series.zero_after_v,
    )


def _known(value: float | None, *, over: float = 1.0) -> float | None:
    """Return value over something, None where either is not known or the second is 0."""
    if value is None or not math.isfinite(value) or not (math.isfinite(over) and over != 0.0):
        return None
    return value / over


def _over(slope: float | None) -> float | None:
    return None if slope is None else _known(1.0, over=slope)
