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
        where = f"step {number} of the plan"
        if isinstance(step, LoadStep):
            locked = step.locked
            found += _load_problems(step, speed, profile, where)
            continue
        found += _segment_problems(step, speed, profile, where)
        if locked and step.kind != "rest":
            fix = "let only rests follow a locked load, or release the lock first"
            found.append(
                UsageError(f"{step.kind} with the wave generator locked", where=where, fix=fix)
            )
        speed = step.end_speed_rad_s(speed)
    return found + _whole_problems(plan, speed, profile)


def _limited(
    where: str, asked: tuple[tuple[str, float, float, str, str], ...], fix: str
) -> list[UsageError]:
    """Return what is above its limit."""
    return [
        UsageError(
            f"{name} {value:.6g} {unit} is above {limit:g} {unit}", where=where, fix=f"{fix} {key}"
        )
        for name, value, limit, unit, key in asked
        if not value <= limit * (1.0 + _ROUNDING)
    ]


def _segment_problems(
    segment: Segment, before: float, profile: ProfileData, where: str
) -> list[UsageError]:
    """Return what is wrong with one segment after a speed."""
    limits, servo = profile.limits, profile.servo
    if segment.kind == "sine":
        peak = abs(before) + abs(segment.speed_rad_s)
    else:
        # unlike max() this hands a NaN on
        peak = float(np.maximum(abs(before), abs(segment.speed_rad_s)))
    volts = peak / servo.velocity_gain_rad_s_per_v
    acceleration = segment.acceleration_rad_s2(before)
    asked = (
        ("motor speed", peak, limits.velocity_rad_s, "rad/s", "limits.velocity_rad_s"),
        ("reference", volts, limits.reference_v, "V", "limits.reference_v"),
        (
            "acceleration",
            acceleration,
            servo.max_acceleration_rad_s2,
            "rad/s^2",
            "servo.max_acceleration_rad_s2",
        ),
    )
    found = _limited(where, asked, "ask for less; the profile's limit is")
    expected = 0.0 if segment.kind == "rest" else segment.speed_rad_s
    if segment.kind in ("hold", "rest") and not abs(before - expected) <= _SAME_SPEED:
        found.append(
            UsageError(
                f"a {segment.kind} at {expected:g} rad/s after {before:g} rad/s is a jump",
                where=where,
                fix="put a ramp before it",
            )
        )
    cycles = segment.frequency_hz * segment.duration_s
    if segment.kind == "sine" and not abs(cycles - round(cycles)) <= _WHOLE_CYCLES:
        found.append(
            UsageError(
                f"{cycles:.6g} cycles of a sine; needed: a whole number",
                where=where,
                fix=f"let it last {max(1, round(cycles)) / segment.frequency_hz:.6g} s",
            )
        )
    if not segment.duration_s >= profile.daq.sample_period_s:
        found.append(
            UsageError(
                f"duration {segment.duration_s:g} s is below one sampling period",
                where=where,
                fix=f"let it last {profile.daq.sample_period_s:g} s or more",
            )
        )
    return found


def _load_problems(
    step: LoadStep, speed: float, profile: ProfileData, where: str
) -> list[UsageError]:
    """Return what is wrong with one load step at a speed."""
    torque = ("torque", abs(step.torque_nm), profile.limits.torque_nm, "N m", "limits.torque_nm")
    found = _limited(where, (torque,), "use a lighter weight; the profile's limit is")
    if not abs(speed) <= _SAME_SPEED:
        found.append(
            UsageError(
                f"a load step at {speed:g} rad/s; needed: the motor at rest",
                where=where,
                fix="put a ramp to 0 before it",
            )
        )
    return found


def _whole_problems(plan: MotionPlan, end_speed: float, profile: ProfileData) -> list[UsageError]:
    """Return what is wrong with a plan as a whole."""
    total = ("duration", plan.duration_s, profile.limits.duration_s, "s", "limits.duration_s")
    found = _limited("the plan", (total,), "ask for less; the profile's limit is")
    if not plan.segments:
        found.append(
            UsageError("no segment; needed: at least one", where="the plan", fix="add a segment")
        )
    if not abs(end_speed) <= _SAME_SPEED:
        found.append(
            UsageError(
                f"the plan ends at {end_speed:g} rad/s; needed: rest",
                where="the plan",
                fix="end it with a ramp to 0",
            )
        )
    parts = max(
        (sum(1 + (s.kind == "sweep") for s in stage.segments) for stage in plan_stages(plan)),
        default=0,
    )
    if parts > MAX_PARTS:
        found.append(
            UsageError(
                f"{parts} parts without a load step between them; needed: at most {MAX_PARTS}",
                where="the plan",
                fix="use fewer segments",
            )
        )
    return found
