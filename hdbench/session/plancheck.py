"""Plans held against the profile's limits, before anything moves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hdbench.devices.feasibility import check_drives, check_pace, check_tables
from hdbench.errors import UsageError
from hdbench.model.program import ReferenceProgram, program_voltage
from hdbench.model.waves import reference_voltage
from hdbench.profile.schema import ProfileData
from hdbench.records import FloatArray
from hdbench.session.calibrating.points import Point
from hdbench.session.plans import Acquire, Plan

__all__ = ["check_plan"]

_ROUNDING = 1e-12


def check_plan(plan: Plan, profile: ProfileData) -> None:
    """Hold every step against the profile's limits; nothing has moved yet."""
    check_tables(profile)
    problems = [*_check_drives(plan, profile), *_check_pace(plan, profile)]
    for number, step in enumerate(plan.steps, start=1):
        where = f"step {number} of the {plan.kind} plan"
        if isinstance(step, Acquire):
            problems.extend(_check_motion(step, profile, where))
        elif isinstance(step, Point):
            problems.extend(_check_load(step, profile, where))
    if problems:
        raise UsageError(
            problems[0].what, where=problems[0].where, fix=problems[0].fix, problems=tuple(problems)
        )


def _check_drives(plan: Plan, profile: ProfileData) -> Iterator[UsageError]:
    """Ask whether anything can move the motor, where the plan does."""
    moving = next((s for s in plan.steps if isinstance(s, Acquire) and s.wave is not None), None)
    if moving is None:
        return
    try:
        check_drives(profile, moving.describe())
    except UsageError as error:
        yield error


def _check_pace(plan: Plan, profile: ProfileData) -> Iterator[UsageError]:
    """Hold the sampling periods against what the device and its wire sustain."""
    periods = {
        step.sample_period_s: step.describe() for step in plan.steps if isinstance(step, Acquire)
    }
    if any(isinstance(step, Point) for step in plan.steps):
        periods[profile.calibration.sample_period_s] = "the calibration"
    for period_s, what in periods.items():
        try:
            check_pace(profile, period_s, what)
        except UsageError as error:
            yield error


def _check_load(point: Point, profile: ProfileData, where: str) -> list[UsageError]:
    """Hold a load against the drive's limit and the converter's range."""
    limit_nm = profile.limits.torque_nm
    volts = abs(point.torque_nm) / profile.sensor.gain_nm_per_v
    problems = []
    if not abs(point.torque_nm) <= limit_nm:
        problems.append(
            UsageError(
                f"{point.torque_nm:+.3f} N m is outside +-{limit_nm:g} N m",
                where=where,
                fix="use a lighter mass, or raise limits.torque_nm if the drive allows it",
            )
        )
    elif not volts <= profile.daq.range_v:
        problems.append(
            UsageError(
                f"{point.torque_nm:+.3f} N m would read {volts:.2f} V; the range ends at "
                f"{profile.daq.range_v:g} V",
                where=where,
                fix="use a lighter mass, or lower the amplifier's gain (and sensor.gain_nm_per_v)",
            )
        )
    return problems


def _travel(step: Acquire, profile: ProfileData) -> tuple[tuple[str, float, float, str, str], ...]:
    """Return how far the motor gets from its start, rad, where the profile limits that."""
    limit = profile.limits.travel_rad
    if limit is None or step.wave is None:
        return ()
    period_s = step.sample_period_s
    if isinstance(step.wave, ReferenceProgram):
        volts = program_voltage(step.wave, period_s)
    else:
        time_s: FloatArray = np.arange(step.n_samples, dtype=np.float64) * period_s
        volts = reference_voltage(step.wave, time_s, step.duration_s)
    angle = np.cumsum(volts) * period_s * profile.servo.velocity_gain_rad_s_per_v
    return (("travel", float(np.max(np.abs(angle), initial=0.0)), limit, "rad", "travel_rad"),)


def _check_motion(step: Acquire, profile: ProfileData, where: str) -> list[UsageError]:
    peak_v = step.peak_v
    velocity = peak_v * profile.servo.velocity_gain_rad_s_per_v
    limits = profile.limits
    asked = (
        ("reference", peak_v, limits.reference_v, "V", "reference_v"),
        ("motor speed", velocity, limits.velocity_rad_s, "rad/s", "velocity_rad_s"),
        ("duration", step.duration_s, limits.duration_s, "s", "duration_s"),
        *_travel(step, profile),
    )
    return [
        UsageError(
            f"{name} {value:.6g} {unit} is above {limit:g} {unit}",
            where=where,
            fix=f"ask for less, or raise limits.{key} in the profile if the bench allows it",
        )
        for name, value, limit, unit, key in asked
        # a speed at its limit comes back from volts with the rounding of a division
        if not value <= limit * (1.0 + _ROUNDING)
    ]
