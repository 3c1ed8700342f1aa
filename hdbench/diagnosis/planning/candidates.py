"""Building blocks of a protocol: stretches of motion that each show something of their own."""

from __future__ import annotations

import math

from hdbench.diagnosis.planning.attended import load_levels, locked_loads, under_load
from hdbench.diagnosis.planning.blockparts import Block, ramp, rounded, runs
from hdbench.diagnosis.planning.segments import MotionPlan, Segment
from hdbench.profile.schema import ProfileData

__all__ = ["blocks", "full_blocks", "full_protocol", "joined", "top_speed_rad_s"]

# speeds stay this far below the limit, which is for what goes wrong
_SPEED_SHARE = 0.95
# a sine of speed keeps its acceleration as far below the servo's as ramps do
_RAMP_SHARE = 0.25
_STEADY_S = 3.0
_STEPS = 9
_SLOWEST_RAD_S = 2.0
# slow reversals: presliding and dry friction live below some ten rad/s
_SLOW_RAD_S, _SLOW_HZ, _SLOW_CYCLES = 8.0, 0.15, 4
# a sine of speed that inertia feels, and whose acceleration the servo still follows
_FAST_HZ, _FAST_CYCLES = 2.0, 16
_REST_S = 8.0
# rest, a long run and rest again: what is slow shows its course
_LONG_S, _LONG_RAD_S, _LONG_LEAST_S = 150.0, 60.0, 40.0


def joined(name: str, chosen: tuple[Block, ...], purpose: str = "") -> MotionPlan:
    """Return blocks as one plan, those that need an operator last.

    Parameters
    ----------
    name : str
        Name of the plan.
    chosen : tuple of Block
        Blocks.
    purpose : str
        Why, in words.

    Returns
    -------
    MotionPlan
    """
    alone = [block for block in chosen if not block.needs_operator]
    attended = [block for block in chosen if block.needs_operator]
    steps = tuple(step for block in (*alone, *attended) for step in block.steps)
    return MotionPlan(name, steps, purpose)


def full_blocks(profile: ProfileData, *, loads: bool = True) -> tuple[Block, ...]:
    """Return the blocks of the full protocol.

    Parameters
    ----------
    profile : ProfileData
        Bench; its limits bound speeds, accelerations and loads.
    loads : bool
        Whether an operator is there to put loads on.

    Returns
    -------
    tuple of Block
        Rest, speeds up and down in both directions, sweeps, sines of speed, slow reversals, output
        turns, rest; then motion under loads of both signs and locked loads at four output angles.
    """
    every = [block for block in blocks(profile, long_s=0.0) if block.name != "constant"]
    alone = [block for block in every if not block.needs_operator]
    attended = [block for block in every if block.needs_operator]
    return (*alone, alone[0], *(attended if loads else ()))


def full_protocol(profile: ProfileData, *, loads: bool = True) -> MotionPlan:
    """Return the protocol that separates all that this bench can separate.

    Parameters
    ----------
    profile : ProfileData
        Bench; its limits bound speeds, accelerations and loads.
    loads : bool
        Whether an operator is there to put loads on.

    Returns
    -------
    MotionPlan
        The blocks of `full_blocks`; 171 s without loads on the built-in profile.
    """
    purpose = "every effect of the catalogue that this bench can show"
    return joined("full", full_blocks(profile, loads=loads), purpose)


def blocks(profile: ProfileData, *, long_s: float = _LONG_S) -> tuple[Block, ...]:
    """Return the building blocks that a bench can do.

    Parameters
    ----------
    profile : ProfileData
        Bench.
    long_s : float
        Length of the long run, s; none below 40 s.

    Returns
    -------
    tuple of Block
        Rest first; those that need an operator last.
    """
    top = top_speed_rad_s(profile)
    middle = 0.4 * top
    return (
        Block(
            "rest",
            (Segment("rest", _REST_S, note="clock, drift and noise alone"),),
            "at rest only the clock and the zero go on: tones, hum and drift stay, everything "
            "that needs motion is gone",
        ),
        _constant(profile, middle),
        _staircase(profile, top),
        Block(
            "sweep",
            tuple(
                Segment("sweep", 20.0, sign * top, note="all speeds, up and down")
                for sign in (1.0, -1.0)
            ),
            "speed goes up and down through every value: lines over the angle move, tones stay, "
            "resonances stand out, and amplitudes show how they grow with speed",
        ),
        _speed_sine(profile, top),
        Block(
            "slow reversals",
            (
                Segment(
                    "sine",
                    _SLOW_CYCLES / _SLOW_HZ,
                    min(_SLOW_RAD_S, top),
                    _SLOW_HZ,
                    note="reversals at low speed",
                ),
            ),
            "many slow reversals: friction repeats at each of them, a step or drift of the zero "
            "does not, and what the first degrees after a reversal show is presliding",
        ),
        _output_turns(profile, top),
        *((_long_run(profile, top, long_s),) if long_s >= _LONG_LEAST_S else ()),
        under_load(profile, middle),
        locked_loads(profile),
        load_levels(profile),
    )


def top_speed_rad_s(profile: ProfileData) -> float:
    """Return the highest speed that a protocol asks for, rad/s.

    Parameters
    ----------
    profile : ProfileData
        Limits and reference gain.

    Returns
    -------
    float
    """
    by_volts = profile.limits.reference_v * profile.servo.velocity_gain_rad_s_per_v
    return float(f"{_SPEED_SHARE * min(profile.limits.velocity_rad_s, by_volts):.3g}")


def _constant(profile: ProfileData, speed: float) -> Block:
    """Return one speed for a while."""
    return Block(
        "constant",
        runs(profile, (rounded(speed),), 20.0, "one speed"),
        "a long steady stretch: orders and their harmonics to fine resolution",
    )


def _staircase(profile: ProfileData, top: float) -> Block:
    """Return speeds in equal ratios, both directions."""
    ratio = (top / _SLOWEST_RAD_S) ** (1.0 / (_STEPS - 1))
    speeds = [rounded(_SLOWEST_RAD_S * ratio**k) for k in range(_STEPS)]
    steps = tuple(
        step
        for sign in (1.0, -1.0)
        for step in runs(profile, tuple(sign * v for v in speeds), _STEADY_S, "speed steps")
    )
    return Block(
        "staircase",
        steps,
        "steady speeds from slow to fast in both directions: an order keeps its angle and a tone "
        "its frequency, amplitudes show whether they grow with speed, and friction changes sign "
        "while the zero does not",
    )


def _speed_sine(profile: ProfileData, top: float) -> Block:
    """Return a fast sine of speed within the ramps' acceleration."""
    most = _RAMP_SHARE * profile.servo.max_acceleration_rad_s2 / (2.0 * math.pi * _FAST_HZ)
    speed = rounded(min(most, 0.5 * top))
    return Block(
        "speed sine",
        (Segment("sine", _FAST_CYCLES / _FAST_HZ, speed, _FAST_HZ, note="acceleration"),),
        "acceleration without much speed: inertia, time skew and what follows the acceleration "
        "come out of what follows the speed",
    )


def _output_turns(profile: ProfileData, top: float) -> Block:
    """Return three whole output turns in each direction."""
    speed = rounded(0.75 * top)
    steady_s = math.ceil(6.0 * math.pi * profile.drive.gear_ratio / speed)
    steps = tuple(
        step
        for sign in (1.0, -1.0)
        for step in runs(profile, (sign * speed,), float(steady_s), "whole output turns")
    )
    return Block(
        "output turns",
        steps,
        "three whole turns of the output each way: what repeats every output turn comes out of "
        "what drifts, and sidebands of the ripple come apart",
    )


def _long_run(profile: ProfileData, top: float, long_s: float) -> Block:
    """Return a long run at one low speed between two rests."""
    speed = rounded(min(_LONG_RAD_S, top))
    rest = Segment("rest", _REST_S, note="zero before and after")
    ramps_s = 2.0 * ramp(profile, 0.0, speed).duration_s
    steady_s = long_s - 2.0 * _REST_S - ramps_s
    return Block(
        "long run",
        (rest, *runs(profile, (speed,), steady_s, "slow effects"), rest),
        "minutes at one speed between two rests: a drift goes on, warming-up bends and comes to an "
        "end, a step happens once",
    )
