"""Limits of a bench against a motion plan, before anything moves."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from operator import attrgetter

import numpy as np

from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment, plan_stages
from hdbench.errors import UsageError
from hdbench.profile.schema import ProfileData
from hdbench.profile.waves import MAX_PARTS

# numbers travel as 32-bit floats and are sums of a few terms of a file: a limit, a cycle or an
# equal speed that is given with few digits is meant to be met
_ROUNDING = 1e-6


def check_motion_plan(plan: MotionPlan, profile: ProfileData) -> list[UsageError]:
    """Return every way in which a plan leaves what the bench may do; empty where it does not.

    Speed, acceleration, reference volts, torque, duration, jumps of the speed, motion while locked,
    no rest at the end, more parts than a node keeps. NaN fails every comparison.
    """
    check = _Check(profile, "")
    speed, locked = 0.0, False
    for number, step in enumerate(plan.steps, start=1):
        check.where = f"step {number} of the plan"
        if isinstance(step, LoadStep):
            locked = step.locked
            fix = "use a lighter weight"
            check.limit("torque", abs(step.torque_nm), "N m", "limits.torque_nm", fix)
            what = f"a load step at {speed:g} rad/s; needed: the motor at rest"
            check.need(abs(speed) <= _ROUNDING, what, "put a ramp to 0 before it")
        else:
            check.segment(step, speed, locked)
            speed = step.end_speed_rad_s(speed)
    check.where = "the plan"
    check.limit("duration", plan.duration_s, "s", "limits.duration_s")
    check.need(bool(plan.segments), "no segment; needed: at least one", "add a segment")
    what = f"the plan ends at {speed:g} rad/s; needed: rest"
    check.need(abs(speed) <= _ROUNDING, what, "end it with a ramp to 0")
    counts = [sum(1 + (s.kind == "sweep") for s in stage.segments) for stage in plan_stages(plan)]
    parts = max(counts, default=0)
    what = f"{parts} parts without a load step between them; needed: at most {MAX_PARTS}"
    check.need(parts <= MAX_PARTS, what, "use fewer segments")
    return check.problems


@dataclass(slots=True)
class _Check:
    """Collects what is wrong at one place after the other."""

    profile: ProfileData
    where: str
    problems: list[UsageError] = field(default_factory=list)

    def need(self, good: bool, what: str, fix: str) -> None:
        if not good:
            self.problems.append(UsageError(what, where=self.where, fix=fix))

    def limit(
        self, name: str, value: float, unit: str, key: str, fix: str = "ask for less"
    ) -> None:
        limit = float(attrgetter(key)(self.profile))
        what = f"{name} {value:.6g} {unit} is above {limit:g} {unit}"
        good = value <= limit * (1.0 + _ROUNDING)
        self.need(good, what, f"{fix}; the profile's limit is {key}")

    def segment(self, segment: Segment, before: float, locked: bool) -> None:
        kind, target, length = segment.kind, segment.speed_rad_s, segment.duration_s
        # unlike max() this hands a NaN on
        peak, acceleration = float(np.maximum(abs(before), abs(target))), 0.0
        if kind == "sine":
            peak = abs(before) + abs(target)
            acceleration = 2.0 * math.pi * segment.frequency_hz * abs(target)
        elif kind in ("ramp", "sweep"):
            acceleration = (1.0 if kind == "ramp" else 2.0) * abs(target - before) / length
        volts = peak / self.profile.servo.velocity_gain_rad_s_per_v
        self.limit("motor speed", peak, "rad/s", "limits.velocity_rad_s")
        self.limit("reference", volts, "V", "limits.reference_v")
        self.limit("acceleration", acceleration, "rad/s^2", "servo.max_acceleration_rad_s2")
        expected = 0.0 if kind == "rest" else target
        jump = kind in ("hold", "rest") and not abs(before - expected) <= _ROUNDING
        what = f"a {kind} at {expected:g} rad/s after {before:g} rad/s is a jump"
        self.need(not jump, what, "put a ramp before it")
        cycles = segment.frequency_hz * length
        whole = float(np.rint(cycles))
        what = f"{cycles:.6g} cycles of a sine; needed: a whole number"
        fix = f"let it last {max(1.0, whole) / (segment.frequency_hz or 1.0):.6g} s"
        self.need(kind != "sine" or abs(cycles - whole) <= _ROUNDING, what, fix)
        period = self.profile.daq.sample_period_s
        what = f"duration {length:g} s is below one sampling period"
        self.need(length >= period, what, f"let it last {period:g} s or more")
        fix = "let only rests follow a locked load, or release the lock first"
        self.need(not locked or kind == "rest", f"{kind} with the wave generator locked", fix)
