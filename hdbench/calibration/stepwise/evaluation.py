"""One group of series, step by step: quantities, uncertainty, class."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdbench.calibration.stepwise.classes import Classification, classify
from hdbench.calibration.stepwise.quantities import StepQuantities, step_quantities
from hdbench.calibration.stepwise.series import LoadSeries, StepGroup
from hdbench.calibration.stepwise.uncertainty import CaseUncertainty, case_one, case_two
from hdbench.calibration.torque.applied import TorqueAccount
from hdbench.records.trace import FloatArray

__all__ = ["GroupEvaluation", "evaluate_group"]


@dataclass(frozen=True, slots=True)
class GroupEvaluation:
    """Everything about one group, step by step.

    Parameters
    ----------
    group : StepGroup
        The series.
    found : StepQuantities
        Their quantities.
    one : tuple of (CaseUncertainty or None)
        Case I: increasing torque, cubic; None for a step without a deflection.
    two : tuple of (CaseUncertainty or None) or None
        Case II: increasing and decreasing torque, line.
    class_one, class_two : Classification
        Class without and with reversibility; with the cubic's and with the line's deviation.
    resolution_v : float or None
        Resolution used, V.
    """

    group: StepGroup
    found: StepQuantities
    one: tuple[CaseUncertainty | None, ...]
    two: tuple[CaseUncertainty | None, ...] | None
    class_one: Classification
    class_two: Classification
    resolution_v: float | None

    def summary(self) -> dict[str, Any]:
        """Return what holds for all steps, as results store it."""
        found, top = self.found, float(self.group.torque_nm[-1])
        sensitivity = float(found.mean_v[-1]) / top
        return {
            **self.group.describe(),
            "n_positions": found.n_positions,
            "n_series": len(self.group.series),
            "n_series_up_down": found.n_both,
            "largest_torque_nm": top,
            "sensitivity_v_per_nm": _known(sensitivity),
            "gain_nm_per_v": _over(sensitivity),
            "gain_up_nm_per_v": _over(found.linear),
            "gain_up_down_nm_per_v": _over(found.linear_both),
            "linear_v_per_nm": _known(found.linear),
            "linear_up_down_v_per_nm": _known(found.linear_both),
            "cubic_v": None if found.cubic is None else [float(c) for c in found.cubic],
            "zero_v": found.zero_v,
            "zero_relative": _known(found.zero_v, over=found.full_v),
            "resolution_v": self.resolution_v,
            "class_increasing": self.class_one.to_dict(),
            "class_increasing_decreasing": self.class_two.to_dict(),
            "zero_by_line": [s.id for s in self.group.series if s.zero_by_line],
            "torque_nm": [float(t) for t in self.group.torque_nm],
            "series": [_series(s) for s in self.group.series],
        }

    def steps(self) -> list[dict[str, Any]]:
        """Return one entry per load step, as results store it."""
        return [self._step(k) for k in range(len(self.group.torque_nm))]

    def _step(self, k: int) -> dict[str, Any]:
        found, torque = self.found, float(self.group.torque_nm[k])
        y = float(found.mean_v[k])
        both = None if found.mean_both_v is None else float(found.mean_both_v[k])
        line = y - found.linear * torque
        cubic = _cubic_at(found, torque)
        h = _at(found.reversibility_v, k)
        out: dict[str, Any] = {
            **self.group.describe(),
            "torque_nm": torque,
            "deflection_v": _known(y),
            "deflection_up_down_v": both,
            "fitted_v": _known(found.linear * torque),
            "repeatability_v": _at(found.repeatability_v, k),
            "reproducibility_v": _at(found.reproducibility_v, k),
            "range_v": _at(found.range_v, k),
            "reversibility_v": h,
            "deviation_linear_v": _known(line),
            "deviation_cubic_v": None if cubic is None else _known(y - cubic),
        }
        for name in (
            "repeatability",
            "reproducibility",
            "range",
            "reversibility",
            "deviation_linear",
            "deviation_cubic",
        ):
            out[f"{name}_relative"] = _known(out[f"{name}_v"], over=y)
        slope = found.linear_both
        off = None if both is None or slope is None else both - slope * torque
        out["deviation_up_down_relative"] = _known(off, over=both or math.nan)
        one, two = self.one[k], None if self.two is None else self.two[k]
        out["increasing"] = None if one is None else one.to_dict(torque)
        out["increasing_decreasing"] = None if two is None else two.to_dict(torque)
        return out


def evaluate_group(
    group: StepGroup, account: TorqueAccount, resolution_v: float | None
) -> GroupEvaluation:
    """Evaluate one group in the manner of EURAMET cg-14.

    Parameters
    ----------
    group : StepGroup
        Series of one direction and range.
    account : TorqueAccount
        Uncertainty of the applied torque.
    resolution_v : float or None
        Resolution of a reading, V.

    Returns
    -------
    GroupEvaluation
    """
    found = step_quantities(group)
    torque = group.torque_nm
    relative = np.array([account.relative_std_at(float(t)) for t in torque])
    one = case_one(found, torque, relative, resolution_v)
    two = case_two(found, torque, relative, resolution_v)
    first, second = _class_values(found, torque, account, resolution_v)
    needed = ("reproducibility",)
    return GroupEvaluation(
        group,
        found,
        tuple(one),
        None if two is None else tuple(two),
        classify(first, needed),
        classify(second, (*needed, "reversibility")),
        resolution_v,
    )


def _class_values(
    found: StepQuantities,
    torque: FloatArray,
    account: TorqueAccount,
    resolution_v: float | None,
) -> tuple[dict[str, float | None], dict[str, float | None]]:
    """Return the largest relative values: for increasing torque, and with decreasing torque."""
    y = found.mean_v
    cubic = [_cubic_at(found, float(t)) for t in torque]
    of_cubic = None if None in cubic else np.abs(y - np.array(cubic, dtype=float))
    shared = {
        "repeatability": _largest(found.repeatability_v, y),
        "reproducibility": _largest(found.reproducibility_v, y),
        "zero": _known(found.zero_v, over=found.full_v),
        "torque": 2.0 * account.relative_std if account.relative_std > 0.0 else None,
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


def _series(series: LoadSeries) -> dict[str, Any]:
    return {
        "id": series.id,
        "position_rad": series.position_rad,
        "position": series.position,
        "repeat": series.repeat,
        "up_v": [_known(float(v)) for v in series.up_v],
        "down_v": [_known(float(v)) for v in series.down_v],
        "zero_before_v": series.zero_before_v,
        "zero_after_v": series.zero_after_v,
    }


def _known(value: float | None, *, over: float = 1.0) -> float | None:
    """Return value over something, None where either is not known or the second is 0."""
    if value is None or not math.isfinite(value) or not (math.isfinite(over) and over != 0.0):
        return None
    return value / over


def _over(slope: float | None) -> float | None:
    return None if slope is None else _known(1.0, over=slope)
