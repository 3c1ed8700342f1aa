"""A motion plan held against a bench's limits, before anything moves."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment, plan_stages
from hdbench.errors import UsageError
from hdbench.model.program import MAX_PARTS
from hdbench.profile.schema import ProfileData

__all__ = ["check_motion_plan"]

# speeds that should be equal come from sums of a few terms of a file
_SAME_SPEED = 1e-9
# the last millionth of a cycle of a sine makes no jump that any servo notices
_WHOLE_CYCLES = 1e-6
# parameters travel as 32-bit floats, and a limit given with few digits is meant to be reached
_ROUNDING = 1e-6

# whether it is as it should be, what is wrong, what to do
_Checks = list[tuple[bool, str, str]]


def check_motion_plan(plan: MotionPlan, profile: ProfileData) -> list[UsageError]:
    """Return every way in which a plan leaves what the bench may do.

    Parameters
    ----------
    plan : MotionPlan
        What is asked for.
    profile : ProfileData
        Limits, servo and sampling period.

    Returns
    -------
    list of UsageError
        Speed, acceleration, reference volts, torque, total duration, jumps of the speed, motion
        while locked, a plan that does not end at rest, or one with more parts than a node keeps.
        NaN fails every comparison.
    """
    found: list[UsageError] = []
    speed, locked = 0.0, False
    for number, step in enumerate(plan.steps, start=1):
        if isinstance(step, LoadStep):
            locked, checks = step.locked, _load(step, speed, profile)
        else:
            checks = _segment(step, speed, locked, profile)
            speed = step.end_speed_rad_s(speed)
        found += _problems(f"step {number} of the plan", checks)
    return found + _problems("the plan", _whole(plan, speed, profile))


def _problems(where: str, checks: _Checks) -> list[UsageError]:
    return [UsageError(what, where=where, fix=fix) for good, what, fix in checks if not good]


def _limit(
    name: str, value: float, limit: float, unit: str, key: str, fix: str = "ask for less"
) -> tuple[bool, str, str]:
    good = bool(value <= limit * (1.0 + _ROUNDING))
    what = f"{name} {value:.6g} {unit} is above {limit:g} {unit}"
    return good, what, f"{fix}; the profile's limit is {key}"


def _segment(segment: Segment, before: float, locked: bool, profile: ProfileData) -> _Checks:
    """Return the checks of one segment after a speed."""
    limits, servo, kind = profile.limits, profile.servo, segment.kind
    here, there = abs(before), abs(segment.speed_rad_s)
    # unlike max() this hands a NaN on
    peak = here + there if kind == "sine" else float(np.maximum(here, there))
    volts = peak / servo.velocity_gain_rad_s_per_v
    asked = segment.acceleration_rad_s2(before)
    most, period = servo.max_acceleration_rad_s2, profile.daq.sample_period_s
    expected = 0.0 if kind == "rest" else segment.speed_rad_s
    cycles = segment.frequency_hz * segment.duration_s
    whole = float(np.rint(cycles))
    return [
        _limit("motor speed", peak, limits.velocity_rad_s, "rad/s", "limits.velocity_rad_s"),
        _limit("reference", volts, limits.reference_v, "V", "limits.reference_v"),
        _limit("acceleration", asked, most, "rad/s^2", "servo.max_acceleration_rad_s2"),
        (
            kind not in ("hold", "rest") or abs(before - expected) <= _SAME_SPEED,
            f"a {kind} at {expected:g} rad/s after {before:g} rad/s is a jump",
            "put a ramp before it",
        ),
        (
            kind != "sine" or abs(cycles - whole) <= _WHOLE_CYCLES,
            f"{cycles:.6g} cycles of a sine; needed: a whole number",
            f"let it last {max(1.0, whole) / (segment.frequency_hz or 1.0):.6g} s",
        ),
        (
            segment.duration_s >= period,
            f"duration {segment.duration_s:g} s is below one sampling period",
            f"let it last {period:g} s or more",
        ),
        (
            not locked or kind == "rest",
            f"{kind} with the wave generator locked",
            "let only rests follow a locked load, or release the lock first",
        ),
    ]


def _load(step: LoadStep, speed: float, profile: ProfileData) -> _Checks:
    """Return the checks of one load step at a speed."""
    torque, most = abs(step.torque_nm), profile.limits.torque_nm
    return [
        _limit("torque", torque, most, "N m", "limits.torque_nm", "use a lighter weight"),
        (
            abs(speed) <= _SAME_SPEED,
            f"a load step at {speed:g} rad/s; needed: the motor at rest",
            "put a ramp to 0 before it",
        ),
    ]


def _whole(plan: MotionPlan, end_speed: float, profile: ProfileData) -> _Checks:
    """Return the checks of a plan as a whole."""
    counts = (sum(1 + (s.kind == "sweep") for s in stage.segments) for stage in plan_stages(plan))
    parts = max(counts, default=0)
    return [
        _limit("duration", plan.duration_s, profile.limits.duration_s, "s", "limits.duration_s"),
        (bool(plan.segments), "no segment; needed: at least one", "add a segment"),
        (
            abs(end_speed) <= _SAME_SPEED,
            f"the plan ends at {end_speed:g} rad/s; needed: rest",
            "end it with a ramp to 0",
        ),
        (
            parts <= MAX_PARTS,
            f"{parts} parts without a load step between them; needed: at most {MAX_PARTS}",
            "use fewer segments",
        ),
    ]
