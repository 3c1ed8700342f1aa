"""The force that a weight on a single arm puts on the flexspline beside its torque."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hdbench.calibration.gains.compare import PairedDifference
from hdbench.calibration.gains.sideforce import DirectionEntry
from hdbench.calibration.lines import ExperimentLine
from hdbench.calibration.readings import TakenReading
from hdbench.calibration.statistics import position_numbers
from hdbench.calibration.torque.applied import TorqueAccount
from hdbench.profile.calibrating import Arm
from hdbench.profile.schema import ProfileData

__all__ = ["direction_entries", "side_force_dict"]


def side_force_dict(
    account: TorqueAccount, direction: PairedDifference | None, arm: Arm | None
) -> dict[str, Any] | None:
    """Return side force, bending moment and what they may do to the gain.

    Notes
    -----
    A weight pulls down in both directions while the torque changes sign: a crosstalk of c V/N
    makes sensitivities ``S + c/L`` and ``S - c/L``. It cancels in the mean of both directions; half
    their difference is the most that it may be, a true asymmetry of the sensor being the rest.
    """
    largest = account.largest
    if largest is None or arm is None or not largest.torque_nm > 0.0:
        return None
    couple = arm.loading == "couple"
    force = 0.0 if couple else largest.torque_nm / largest.length_m
    distance = arm.side_force_distance_m
    return {
        "force_n": force,
        "bending_nm": None if distance is None else force * distance,
        "half_direction_difference": None if direction is None else abs(direction.relative) / 2.0,
        "cancels": couple or direction is not None,
        "reason": _reason(couple, direction),
    }


def _reason(couple: bool, direction: PairedDifference | None) -> str:
    if couple:
        return "a couple has no side force"
    if direction is None:
        return "one direction only: its crosstalk stands in the gain, with a size that is not known"
    return "its crosstalk changes sign with the direction and cancels in the mean of both"


def direction_entries(
    readings: Sequence[TakenReading],
    lines: tuple[ExperimentLine, ...],
    bench: ProfileData | None,
) -> list[DirectionEntry]:
    """Return the sensitivity of each experiment and how its torque was applied."""
    first: dict[str, TakenReading] = {}
    for taken in readings:
        first.setdefault(taken.reading.experiment, taken)
    out = []
    for number, line in zip(position_numbers(lines), lines, strict=True):
        detail = first[line.id].detail
        loading = detail.loading or (None if bench is None else bench.arm.loading) or "single"
        length = detail.arm_length_m or (None if bench is None else bench.arm.length_m)
        lever = 0.0 if loading == "couple" else 1.0 / (length or 1.0)
        out.append(DirectionEntry(number, line.direction, 1.0 / line.gain_nm_per_v.value, lever))
    return out
