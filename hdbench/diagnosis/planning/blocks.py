"""Blocks of a protocol: stretches of motion that each show something of their own."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable
from importlib import resources
from itertools import product

from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment
from hdbench.profile.schema import ProfileData

Steps = tuple[Segment | LoadStep, ...]

# ramps stay this far below the servo's acceleration: a servo at its limit does not follow
_RAMP_SHARE = 0.25
# length of a rest; a long run between two of them shows the course of what is slow
_REST_S = 8.0
# a sine of speed that inertia feels, and whose acceleration the servo still follows
_FAST_HZ = 2.0
_PURPOSES: dict[str, str] = tomllib.loads(
    (resources.files(__package__) / "blocks.toml").read_text(encoding="utf-8")
)


def joined(name: str, chosen: Iterable[MotionPlan], purpose: str = "") -> MotionPlan:
    """Return blocks as one plan, those that need an operator last."""
    ordered = sorted(chosen, key=lambda block: block.needs_operator)
    return MotionPlan(name, tuple(step for block in ordered for step in block.steps), purpose)


def full_blocks(profile: ProfileData, *, loads: bool = True) -> tuple[MotionPlan, ...]:
    """Return the blocks of the full protocol, those with loads only where an operator is there."""
    every = [block for block in blocks(profile, long_s=0.0) if block.name != "constant"]
    attended = [block for block in every if block.needs_operator and loads]
    return (*(block for block in every if not block.needs_operator), every[0], *attended)


def full_protocol(profile: ProfileData, *, loads: bool = True) -> MotionPlan:
    """Return the protocol that separates all that this bench can separate."""
    purpose = "every effect of the catalogue that this bench can show"
    return joined("full", full_blocks(profile, loads=loads), purpose)


def blocks(profile: ProfileData, *, long_s: float = 150.0) -> tuple[MotionPlan, ...]:
    """Return the blocks that a bench can do, rest first, those with an operator last."""
    by_volts = profile.limits.reference_v * profile.servo.velocity_gain_rad_s_per_v
    # speeds stay below the limit, which is for what goes wrong
    top = _rounded(0.95 * min(profile.limits.velocity_rad_s, by_volts))
    middle, turning = 0.4 * top, _rounded(0.75 * top)
    # three turns of the output
    turns_s = math.ceil(6.0 * math.pi * profile.drive.gear_ratio / turning)
    most = _RAMP_SHARE * profile.servo.max_acceleration_rad_s2 / (2.0 * math.pi * _FAST_HZ)
    fast = _rounded(min(most, 0.5 * top))
    steps: dict[str, Steps] = {
        "rest": (Segment("rest", _REST_S, note="clock, drift and noise alone"),),
        "constant": _runs(profile, [_rounded(middle)], 20.0, "one speed"),
        # nine speeds in equal ratios from 2 rad/s
        "staircase": _both_ways(
            profile,
            [_rounded(2.0 * (top / 2.0) ** (k / 8.0)) for k in range(9)],
            3.0,
            "speed steps",
        ),
        "sweep": tuple(
            Segment("sweep", 20.0, speed, note="all speeds, up and down") for speed in (top, -top)
        ),
        "speed sine": (Segment("sine", 16 / _FAST_HZ, fast, _FAST_HZ, note="acceleration"),),
        # presliding and dry friction live below some ten rad/s
        "slow reversals": (
            Segment("sine", 4 / 0.15, min(8.0, top), 0.15, note="reversals at low speed"),
        ),
        "output turns": _both_ways(profile, [turning], float(turns_s), "whole output turns"),
    }
    if long_s >= 40.0:
        steps["long run"] = _long_run(profile, top, long_s)
    # output angles of locked loads: four equal steps would hide the second order
    angles_rad = (0.0, 1.771, 3.142, 4.912)
    # two levels of each sign fix size and bend of any curve over the load, more test its law
    levels = (0.2, 0.4, 0.6, 0.8, 1.0, 0.8, 0.6, 0.4, 0.2)
    steps |= {
        "moving under load": _under_load(profile, middle),
        "locked load": _locked(
            profile, product(angles_rad, (0.3, 0.8, 0.3, -0.3, -0.8, -0.3)), 4.0
        ),
        "load levels": _locked(
            profile, [(0.0, sign * s) for sign in (1.0, -1.0) for s in levels], 3.0
        ),
    }
    return tuple(MotionPlan(name, some, _PURPOSES[name]) for name, some in steps.items())


def _rounded(value: float) -> float:
    """Return a value with three digits."""
    return float(f"{value:.3g}")


def _runs(profile: ProfileData, speeds: list[float], steady_s: float, note: str) -> Steps:
    """Return speeds, rad/s, one after the other for as long each, from rest to rest."""
    before, steps = 0.0, list[Segment]()
    for speed in speeds:
        steps.append(_ramp(profile, before, speed))
        steps.append(Segment("hold", steady_s, speed, note=note))
        before = speed
    return (*steps, _ramp(profile, before, 0.0))


def _ramp(profile: ProfileData, before: float, after: float) -> Segment:
    """Return a ramp within the servo's acceleration, in tenths of a second."""
    needed = abs(after - before) / (_RAMP_SHARE * profile.servo.max_acceleration_rad_s2)
    # half a second leaves the servo's lag and the window of the acceleration behind
    return Segment("ramp", max(0.5, math.ceil(10.0 * needed) / 10.0), after)


def _both_ways(profile: ProfileData, speeds: list[float], steady_s: float, note: str) -> Steps:
    """Return speeds, rad/s, one after the other, then those of the other direction."""
    back = [-speed for speed in speeds]
    return _runs(profile, speeds, steady_s, note) + _runs(profile, back, steady_s, note)


def _long_run(profile: ProfileData, top: float, long_s: float) -> Steps:
    """Return a long run at one low speed between two rests."""
    speed = _rounded(min(60.0, top))
    rest = Segment("rest", _REST_S, note="zero before and after")
    ramps_s = 2.0 * _ramp(profile, 0.0, speed).duration_s
    steady_s = long_s - 2.0 * _REST_S - ramps_s
    return (rest, *_runs(profile, [speed], steady_s, "slow effects"), rest)


def _under_load(profile: ProfileData, speed: float) -> Steps:
    """Return motion under constant loads of both signs."""
    speed = _rounded(min(speed, 100.0))
    steps: list[Segment | LoadStep] = []
    for share in (0.3, -0.3, 0.6, -0.6):
        torque, side = _load(profile, share)
        text = (
            f"hang a load of {abs(torque):g} N m on the {side} side by a rope over a drum, "
            "so that it stays the same while the output turns"
        )
        steps.append(LoadStep(text, torque))
        steps += _runs(profile, [speed, -speed], 4.0, "motion under load")
    return (*steps, LoadStep("take all loads off", 0.0))


def _locked(profile: ProfileData, loads: Iterable[tuple[float, float]], seconds: float) -> Steps:
    """Return loads on the locked drive, each an output angle, rad, and a share of rated torque."""
    steps: list[Segment | LoadStep] = []
    for angle_rad, share in loads:
        torque, side = _load(profile, share)
        text = (
            f"lock the wave generator with the flexspline at {math.degrees(angle_rad):.1f} degrees "
            f"and load {abs(torque):g} N m {side}"
        )
        steps.append(LoadStep(text, torque, locked=True, position_rad=angle_rad))
        steps.append(Segment("rest", seconds, note="locked load"))
    return (*steps, LoadStep("take all loads off and release the wave generator", 0.0))


def _load(profile: ProfileData, share: float) -> tuple[float, str]:
    """Return a share of the rated torque within the limit, N m, and the side of the load."""
    torque = _rounded(share * min(profile.drive.rated_torque_nm, profile.limits.torque_nm))
    return torque, "cw" if torque > 0.0 else "ccw"
