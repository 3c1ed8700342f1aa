"""What is to be thought of a reading before it is accepted."""

from __future__ import annotations

from dataclasses import dataclass

from hdbench.profile.schema import ProfileData
from hdbench.session.calibrating.checks import rest_problem, shunt_problem
from hdbench.session.calibrating.guard import Expectation, Guard
from hdbench.session.calibrating.points import Point
from hdbench.session.calibrating.reading import Taken
from hdbench.session.calibrating.state import CalibrationState

__all__ = ["Doubt", "doubt_about", "expectation_of"]

# Share of its load step by which the first zero of a mounting may differ from the bridge at rest:
# orders 2 and 4 of the wave generator shift it from position to position, and the lightest weight
# left on the arm by mistake is one step.
_ZERO_SHIFT = 0.75


@dataclass(frozen=True, slots=True)
class Doubt:
    """A reason to ask before a reading is accepted.

    Parameters
    ----------
    flag : str
        Word that marks the reading if it is accepted all the same.
    problem : str
        The reason in words.
    """

    flag: str
    problem: str


def expectation_of(
    point: Point, state: CalibrationState, profile: ProfileData
) -> tuple[Expectation, bool]:
    """Return what a point should read, and whether its mounting has a zero of its own."""
    zero_v = state.zero_v(point)
    base_v = zero_v if zero_v is not None else (state.rest_v() or 0.0)
    found = Expectation.of(base_v, state.deflections(), profile.sensor.gain_nm_per_v)
    return found, zero_v is not None


def doubt_about(
    point: Point, taken: Taken, state: CalibrationState, profile: ProfileData
) -> Doubt | None:
    """Return what speaks against accepting a reading."""
    reading_v = taken.reading.mean_v
    if taken.saturated:
        return Doubt("saturated", f"the converter is at the end of its range: {reading_v:+.3f} V.")
    if point.role == "zero-check":
        problem = rest_problem(reading_v, state.points, profile)
        return None if problem is None else Doubt("zero", problem)
    if point.role == "shunt":
        problem = shunt_problem(reading_v - (state.rest_v() or 0.0), profile)
        return None if problem is None else Doubt("shunt", problem)
    expectation, own_zero = expectation_of(point, state, profile)
    share = profile.calibration.gross_error_fraction if own_zero else _ZERO_SHIFT
    error = Guard.of(state.points, profile).find(point, reading_v, expectation, share)
    return None if error is None else Doubt("confirmed-gross-error", error.describe())
