"""The metrological evaluation as results store it."""

from __future__ import annotations

from typing import Any

from hdbench.calibration.budget import budget_dicts
from hdbench.calibration.gains.mixed import MixedFit
from hdbench.calibration.gains.outliers import GainOutlier
from hdbench.calibration.lines import ExperimentLine
from hdbench.calibration.metrology import Metrology
from hdbench.calibration.stepwise.classes import Classification
from hdbench.calibration.torque.sideforce import side_force_dict
from hdbench.profile.calibrating import Arm

__all__ = ["METHOD", "metrology_dict", "overall_class"]

METHOD = "in the manner of EURAMET cg-14, indicative, not checked against its text"
_UNIT = "N m/V"


def overall_class(found: Metrology) -> Classification:
    """Return the worst class of the directions of the widest range."""
    if not found.groups:
        return Classification(None, "nothing was loaded", (), ())
    widest = found.groups[0].group.range
    chosen = [
        group.class_one if group.two is None else group.class_two
        for group in found.groups
        if group.group.range == widest
    ]
    for one in chosen:
        if one.value is None:
            return one
    return max(chosen, key=lambda one: one.value or 0.0)


def metrology_dict(
    found: Metrology, lines: tuple[ExperimentLine, ...], value: float, arm: Arm | None
) -> dict[str, Any]:
    """Return the keys that the metrological evaluation adds to a calibration result."""
    grade = overall_class(found)
    naive, any_one = found.naive, found.any_one
    return {
        "method": METHOD,
        "steps": [step for group in found.groups for step in group.steps()],
        "class": grade.value,
        "class_reason": f"{METHOD}; {grade.reason}",
        "groups": [
            {**group.summary(), "lack_of_fit": None if lack is None else lack.to_dict()}
            for group, lack in zip(found.groups, found.lack, strict=True)
        ],
        "uncertainty": {
            "mean_of_positions": found.mean.to_dict(value, _UNIT),
            "any_one_position": None if any_one is None else any_one.to_dict(value, _UNIT),
            "naive": None if naive is None else naive.to_dict(value, _UNIT),
            "naive_reason": "takes every experiment as independent, which those that share a "
            "position are not; for comparison only",
        },
        "positions": None if found.positions is None else found.positions.to_dict(),
        "mixed_model": _mixed(found.mixed),
        "direction": None if found.direction is None else found.direction.to_dict(),
        "direction_effects": found.effects.to_dict(),
        "ranges": None if found.ranges is None else found.ranges.to_dict(),
        "consensus": None if found.consensus is None else found.consensus.to_dict(),
        "hysteresis": {name: loop.to_dict() for name, loop in found.loops.items()},
        "outliers": [
            *(_outlier(o, lines) for o in found.outliers),
            *(odd.to_dict() for odd in found.odd),
        ],
        "torque": found.account.to_dict(),
        "side_force": side_force_dict(found.account, found.direction, arm),
        "budget": budget_dicts(found.rows),
    }


def _mixed(fit: MixedFit | None) -> dict[str, Any] | None:
    if fit is None:
        return None
    return {
        "method": "restricted maximum likelihood, directions and ranges fixed, position random",
        "gain_nm_per_v": fit.gain.to_dict(),
        "between_positions_nm_per_v": fit.between_std,
        "repeatability_nm_per_v": fit.repeatability,
    }


def _outlier(outlier: GainOutlier, lines: tuple[ExperimentLine, ...]) -> dict[str, Any]:
    own = [lines[place] for place in outlier.places]
    return {
        "kind": outlier.kind,
        "experiment": ", ".join(line.id for line in own),
        "position_rad": own[0].position_rad,
        "statistic": outlier.statistic,
        "limit": outlier.limit,
    }
