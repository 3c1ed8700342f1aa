"""One group of series, step by step: quantities, uncertainty, class."""

from __future__ import annotations

import math

import numpy as np

from hdbench.calibration.budget import relative_std
from hdbench.calibration.curve import series_lack_of_fit
from hdbench.calibration.stepwise.classes import classify
from hdbench.calibration.stepwise.quantities import StepQuantities, step_quantities
from hdbench.calibration.stepwise.series import LoadSeries, StepGroup
from hdbench.calibration.stepwise.uncertainty import case_one, case_two
from hdbench.calibration.torque.applied import TorqueAccount
from hdbench.records.trace import FloatArray
from hdbench.results.calibration import GroupSeries, LoadGroup, LoadStep, StepUncertainty


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
