"""Plausibility of a reading: rest, shunt, and gross errors with the weight that explains them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter

import numpy as np

from hdbench.profile.calibrating import Arm
from hdbench.profile.schema import ProfileData
from hdbench.session.calibrating.reading import Taken
from hdbench.session.calibrating.state import CalibrationState
from hdbench.session.plans import Point

# The bridge at rest may be off by this share of the signal of the largest load: more is wiring, a
# mounting under stress or a weight left on the arm. Order 2 and 4 of a wave generator that stands
# at another angle make 2 % on the report's bench.
_ZERO_SHARE = 0.2

# Room left to the ends of the range: a gain wrong by this share still fits.
_ROOM = 0.05


def rest_problem(rest_v: float, points: Sequence[Point], profile: ProfileData) -> str | None:
    """Return what is wrong with the bridge at rest."""
    gain, range_v = profile.sensor.gain_nm_per_v, profile.daq.range_v
    volts = [point.torque_nm / gain for point in points]
    largest_v = max((abs(volt) for volt in volts), default=0.0)
    ends = [rest_v + volt * (1.0 + _ROOM) for volt in (min(volts), max(volts))]
    worst = max(ends, key=abs)
    if not abs(worst) <= range_v:
        return (
            f"the bridge rests at {rest_v:+.3f} V and would reach {worst:+.3f} V under the "
            f"heaviest weight; the range ends at {range_v:g} V"
        )
    allowed = _ZERO_SHARE * largest_v
    if not abs(rest_v) <= allowed:
        return (
            f"the bridge rests at {rest_v:+.3f} V ({rest_v * gain:+.2f} N m); expected within "
            f"{allowed:.3f} V of zero: is a weight on the arm, or the bridge under stress?"
        )
    return None


def shunt_problem(change_v: float, profile: ProfileData) -> str | None:
    """Return what is wrong with the shunt reading."""
    shunt = profile.calibration.shunt
    if shunt is None or shunt.expected_v is None:
        return None
    allowed = shunt.tolerance * abs(shunt.expected_v)
    if abs(change_v - shunt.expected_v) <= allowed:
        return None
    return (
        f"the shunt changes the reading by {change_v:+.4f} V; expected {shunt.expected_v:+.4f} V "
        f"+- {allowed:.4f} V: amplifier, excitation or wiring have changed"
    )


# Readings with weight needed before their own gain replaces the profile's: the median of three
# stands even if one of them is wrong.
_LEAST_READINGS = 3

# Share of the smallest step between weights within which a weight explains a reading.
_EXPLAINS = 0.3


def learnt_gain(accepted: Sequence[tuple[float, float]], gain_nm_per_v: float) -> float:
    """Return the median gain of accepted torques, N m, and volts; with few, the one given."""
    gains = [torque / volts for torque, volts in accepted if volts != 0.0]
    median = float(np.median(gains)) if len(gains) >= _LEAST_READINGS else 0.0
    return median or gain_nm_per_v


@dataclass(frozen=True, slots=True)
class Expectation:
    """What a reading should be."""

    zero_v: float
    gain_nm_per_v: float
    # whether the mounting has a zero of its own, else the bridge at rest stands for it
    own_zero: bool = True

    @classmethod
    def of(cls, point: Point, state: CalibrationState, gain_nm_per_v: float) -> Expectation:
        """Return what the accepted readings lead to expect of a point."""
        zero_v = state.zero_v(point)
        rest_v = state.rest_v() or 0.0
        gain = learnt_gain(state.deflections(), gain_nm_per_v)
        return cls(rest_v if zero_v is None else zero_v, gain, zero_v is not None)

    def volts(self, torque_nm: float) -> float:
        """Return the reading expected of a torque, V."""
        return self.zero_v + torque_nm / self.gain_nm_per_v

    def torque_nm(self, reading_v: float) -> float:
        """Return the torque that a reading means, N m."""
        return (reading_v - self.zero_v) * self.gain_nm_per_v


def weights_of(points: Sequence[Point]) -> list[float]:
    """Return the weights of a sequence, kg; none at all is one of them."""
    return sorted({0.0, *(point.mass_kg for point in points)})


def gross_error(
    point: Point, read_nm: float, share: float, weights_kg: Sequence[float], arm: Arm
) -> str | None:
    """Return what is wrong with a torque that is further off than a share of the load step."""
    if abs(read_nm - point.torque_nm) <= share * point.step_nm:
        return None
    guess = _guess(point, read_nm, weights_kg, arm)
    asked = guess or "no weight of the set explains it: check arm, side and cable"
    return f"expected {point.torque_nm:+.2f} N m, read {read_nm:+.2f} N m: {asked}"


def _guess(point: Point, read_nm: float, weights_kg: Sequence[float], arm: Arm) -> str | None:
    """Return which weight, on which side, would give the torque."""
    lever_nm_per_kg = arm.gravity_m_s2 * arm.length_m
    sign = -1.0 if point.direction == "ccw" else 1.0
    candidates = []
    for mass in weights_kg:
        hung_nm = lever_nm_per_kg * (mass + (arm.tare_kg if mass else 0.0))
        candidates += [(abs(read_nm - side * hung_nm), side, mass) for side in (sign, -sign)]
    others = [other for other in candidates if other[1:] != (sign, point.mass_kg)]
    away_nm, side, mass = min(others, key=itemgetter(0))
    step_kg = min((b - a for a, b in pairwise(weights_kg)), default=0.0)
    # written so that a reading that is no number has no explanation
    if not away_nm <= _EXPLAINS * lever_nm_per_kg * step_kg:
        return None
    if mass == 0.0:
        return "does no weight hang?"
    other = "" if side == sign else f" on the {'ccw' if side < 0.0 else 'cw'} side"
    return f"did you hang {mass:g} kg{other}?"


# Share of its load step by which the first zero of a mounting may differ from the bridge at rest:
# orders 2 and 4 of the wave generator shift it from position to position, and the lightest weight
# left on the arm by mistake is one step.
_ZERO_SHIFT = 0.75


def doubt_about(
    point: Point, taken: Taken, state: CalibrationState, profile: ProfileData
) -> tuple[str, str] | None:
    """Return the mark of a reading that is in doubt, and the reason in words."""
    reading_v = taken.reading.mean_v
    if taken.saturated:
        return "saturated", f"the converter is at the end of its range: {reading_v:+.3f} V."
    if point.role == "zero-check":
        mark, problem = "zero", rest_problem(reading_v, state.points, profile)
    elif point.role == "shunt":
        change_v = reading_v - (state.rest_v() or 0.0)
        mark, problem = "shunt", shunt_problem(change_v, profile)
    else:
        expected = Expectation.of(point, state, profile.sensor.gain_nm_per_v)
        share = profile.calibration.gross_error_fraction if expected.own_zero else _ZERO_SHIFT
        weights_kg, read_nm = weights_of(state.points), expected.torque_nm(reading_v)
        mark = "confirmed-gross-error"
        problem = gross_error(point, read_nm, share, weights_kg, profile.arm)
    return None if problem is None else (mark, problem)
