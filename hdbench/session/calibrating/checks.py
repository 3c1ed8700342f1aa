"""Before the first weight: bridge zero, room to the converter's ends, shunt."""

from __future__ import annotations

from collections.abc import Sequence

from hdbench.profile.schema import ProfileData
from hdbench.session.calibrating.points import Point

__all__ = ["rest_problem", "shunt_problem"]

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
