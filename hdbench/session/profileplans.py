"""The motion that a profile itself asks for, as plans."""

from __future__ import annotations

import math

from hdbench.profile.schema import ProfileData, ReferenceWave
from hdbench.session.plans import Acquire, Lock, Plan

__all__ = ["misalignment_plan", "ripple_plan"]

_RAMP_SHARE = 4.0  # ramps last four times as long as the servo at its limit would need


def misalignment_plan(profile: ProfileData) -> Plan:
    """Plan a constant velocity over the profile's output turns, one direction after the other."""
    run = profile.misalignment
    turn_s = 2.0 * math.pi * profile.drive.gear_ratio / run.velocity_rad_s
    ramp_s = _RAMP_SHARE * run.velocity_rad_s / profile.servo.max_acceleration_rad_s2
    half_s = run.output_turns * turn_s + run.settle_s + 2.0 * ramp_s
    wave = ReferenceWave(
        wave="trapezoid",
        amplitude_v=run.velocity_rad_s / profile.servo.velocity_gain_rad_s_per_v,
        frequency_hz=0.5 / half_s,
        duty=1.0 - 2.0 * ramp_s / half_s,
        rise=ramp_s / half_s,
        fall=ramp_s / half_s,
    )
    return Plan(
        "misalignment",
        (Lock(locked=False), Acquire(wave, profile.daq.sample_period_s, 2.0 * half_s)),
        2.0 * half_s,
    )


def ripple_plan(profile: ProfileData) -> Plan:
    """Plan the free motion with the profile's reference generator."""
    run = profile.ripple
    return Plan(
        "ripple",
        (
            Lock(locked=False),
            Acquire(run.reference, profile.daq.sample_period_s, run.duration_s),
        ),
        run.duration_s,
    )
