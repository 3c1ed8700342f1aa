"""Building blocks of a protocol: stretches of motion that each show something of their own."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment
from hdbench.profile.schema import ProfileData

__all__ = ["Block", "blocks", "full_blocks", "full_protocol", "joined"]

Steps = tuple[Segment | LoadStep, ...]

# ramps stay this far below the servo's acceleration: a servo at its limit does not follow
_RAMP_SHARE = 0.25
# no ramp is shorter: the servo's lag and the window of the acceleration are behind it then
_SHORTEST_RAMP_S = 0.5
# speeds stay this far below the limit, which is for what goes wrong
_SPEED_SHARE = 0.95
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
_LOAD_SHARES = (0.3, 0.6)
_LOCKED_PLACES = 4
_LOCKED_S = 4.0
# two levels of each sign fix the size and the bend of any curve over the load, more test its law
_LEVELS = (0.2, 0.4, 0.6, 0.8, 1.0)
_LEVEL_S = 3.0


@dataclass(frozen=True, slots=True)
class Block:
    """A building block: its name, steps from rest to rest, and in words what it tells apart."""

    name: str
    steps: Steps
    shows: str

    @property
    def duration_s(self) -> float:
        """Length, s."""
        return MotionPlan(self.name, self.steps).duration_s

    @property
    def needs_operator(self) -> bool:
        """Whether a person has to do something."""
        return any(isinstance(step, LoadStep) for step in self.steps)


def joined(name: str, chosen: tuple[Block, ...], purpose: str = "") -> MotionPlan:
    """Return blocks as one plan, those that need an operator last."""
    ordered = sorted(chosen, key=lambda block: block.needs_operator)
    return MotionPlan(name, tuple(step for block in ordered for step in block.steps), purpose)


def full_blocks(profile: ProfileData, *, loads: bool = True) -> tuple[Block, ...]:
    """Return the blocks of the full protocol, those with loads only where an operator is there."""
    every = [block for block in blocks(profile, long_s=0.0) if block.name != "constant"]
    attended = [block for block in every if block.needs_operator and loads]
    return (*(b for b in every if not b.needs_operator), every[0], *attended)


def full_protocol(profile: ProfileData, *, loads: bool = True) -> MotionPlan:
    """Return the protocol that separates all that this bench can separate.

    Parameters
    ----------
    profile : ProfileData
        Bench; its limits bound speeds, accelerations and loads.
    loads : bool
        Whether an operator is there to put loads on; without them it takes 171 s on the built-in
        profile.

    Returns
    -------
    MotionPlan
    """
    purpose = "every effect of the catalogue that this bench can show"
    return joined("full", full_blocks(profile, loads=loads), purpose)


def blocks(profile: ProfileData, *, long_s: float = _LONG_S) -> tuple[Block, ...]:
    """Return the building blocks that a bench can do: rest first, those with an operator last.

    Parameters
    ----------
    profile : ProfileData
        Bench.
    long_s : float
        Length of the long run, s; none below 40 s.

    Returns
    -------
    tuple of Block
    """
    by_volts = profile.limits.reference_v * profile.servo.velocity_gain_rad_s_per_v
    top = _rounded(_SPEED_SHARE * min(profile.limits.velocity_rad_s, by_volts))
    middle, slow = 0.4 * top, min(_SLOW_RAD_S, top)
    sweeps = (Segment("sweep", 20.0, s * top, note="all speeds, up and down") for s in (1.0, -1.0))
    reversals = Segment(
        "sine", _SLOW_CYCLES / _SLOW_HZ, slow, _SLOW_HZ, note="reversals at low speed"
    )
    return (
        Block(
            "rest",
            (Segment("rest", _REST_S, note="clock, drift and noise alone"),),
            "at rest only the clock and the zero go on: tones, hum and drift stay, everything "
            "that needs motion is gone",
        ),
        Block(
            "constant",
            _runs(profile, (_rounded(middle),), 20.0, "one speed"),
            "a long steady stretch: orders and their harmonics to fine resolution",
        ),
        _staircase(profile, top),
        Block(
            "sweep",
            tuple(sweeps),
            "speed goes up and down through every value: lines over the angle move, tones stay, "
            "resonances stand out, and amplitudes show how they grow with speed",
        ),
        _speed_sine(profile, top),
        Block(
            "slow reversals",
            (reversals,),
            "many slow reversals: friction repeats at each of them, a step or drift of the zero "
            "does not, and what the first degrees after a reversal show is presliding",
        ),
        _output_turns(profile, top),
        *((_long_run(profile, top, long_s),) if long_s >= _LONG_LEAST_S else ()),
        _under_load(profile, middle),
        _locked_loads(profile),
        _load_levels(profile),
    )


def _ramp(profile: ProfileData, before: float, after: float) -> Segment:
    """Return a ramp within a quarter of the servo's acceleration, in tenths of a second."""
    needed = abs(after - before) / (_RAMP_SHARE * profile.servo.max_acceleration_rad_s2)
    return Segment("ramp", max(_SHORTEST_RAMP_S, math.ceil(10.0 * needed) / 10.0), after)


def _runs(profile: ProfileData, speeds: tuple[float, ...], steady_s: float, note: str) -> Steps:
    """Return speeds, rad/s, one after the other for as long each, from rest to rest."""
    before, steps = 0.0, list[Segment]()
    for speed in speeds:
        steps.append(_ramp(profile, before, speed))
        steps.append(Segment("hold", steady_s, speed, note=note))
        before = speed
    return (*steps, _ramp(profile, before, 0.0))


def _rounded(value: float) -> float:
    """Return a value with three digits."""
    return float(f"{value:.3g}")


def _staircase(profile: ProfileData, top: float) -> Block:
    """Return speeds in equal ratios, both directions."""
    ratio = (top / _SLOWEST_RAD_S) ** (1.0 / (_STEPS - 1))
    speeds = [_rounded(_SLOWEST_RAD_S * ratio**k) for k in range(_STEPS)]
    steps = tuple(
        step
        for sign in (1.0, -1.0)
        for step in _runs(profile, tuple(sign * v for v in speeds), _STEADY_S, "speed steps")
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
    speed = _rounded(min(most, 0.5 * top))
    return Block(
        "speed sine",
        (Segment("sine", _FAST_CYCLES / _FAST_HZ, speed, _FAST_HZ, note="acceleration"),),
        "acceleration without much speed: inertia, time skew and what follows the acceleration "
        "come out of what follows the speed",
    )


def _output_turns(profile: ProfileData, top: float) -> Block:
    """Return three whole output turns in each direction."""
    speed = _rounded(0.75 * top)
    steady_s = float(math.ceil(6.0 * math.pi * profile.drive.gear_ratio / speed))
    steps = tuple(
        step
        for sign in (1.0, -1.0)
        for step in _runs(profile, (sign * speed,), steady_s, "whole output turns")
    )
    return Block(
        "output turns",
        steps,
        "three whole turns of the output each way: what repeats every output turn comes out of "
        "what drifts, and sidebands of the ripple come apart",
    )


def _long_run(profile: ProfileData, top: float, long_s: float) -> Block:
    """Return a long run at one low speed between two rests."""
    speed = _rounded(min(_LONG_RAD_S, top))
    rest = Segment("rest", _REST_S, note="zero before and after")
    ramps_s = 2.0 * _ramp(profile, 0.0, speed).duration_s
    steady_s = long_s - 2.0 * _REST_S - ramps_s
    return Block(
        "long run",
        (rest, *_runs(profile, (speed,), steady_s, "slow effects"), rest),
        "minutes at one speed between two rests: a drift goes on, warming-up bends and comes to an "
        "end, a step happens once",
    )


def _under_load(profile: ProfileData, speed: float) -> Block:
    """Return motion under constant loads of both signs."""
    speed = _rounded(min(speed, 100.0))
    steps: list[Segment | LoadStep] = []
    for share in _LOAD_SHARES:
        torque = _load_nm(profile, share)
        for sign, side in ((1.0, "cw"), (-1.0, "ccw")):
            text = (
                f"hang a load of {torque:g} N m on the {side} side by a rope over a drum, "
                "so that it stays the same while the output turns"
            )
            steps.append(LoadStep(text, sign * torque))
            steps += _runs(profile, (speed, -speed), 4.0, "motion under load")
    steps.append(LoadStep("take all loads off", 0.0))
    return Block(
        "moving under load",
        tuple(steps),
        "the same motion under loads of both signs: what grows with the load's size, with its "
        "sign, or not at all",
    )


def _locked_loads(profile: ProfileData) -> Block:
    """Return loads at several output angles with the wave generator locked."""
    steps: list[Segment | LoadStep] = []
    for place in range(_LOCKED_PLACES):
        # off the symmetry of the second order, which four equal steps would hide
        angle = round(2.0 * math.pi * place / _LOCKED_PLACES + 0.2 * (place % 2), 3)
        for share in (0.3, 0.8, 0.3, -0.3, -0.8, -0.3):
            steps += _locked(profile, angle, share, _LOCKED_S)
    steps.append(LoadStep("take all loads off and release the wave generator", 0.0))
    return Block(
        "locked load",
        tuple(steps),
        "loads up and down, both signs, at four output angles with nothing moving: gain, its "
        "change over the angle, non-linearity and hysteresis without ripple and friction",
    )


def _load_levels(profile: ProfileData) -> Block:
    """Return loads of many levels at one output angle with the wave generator locked."""
    steps: list[Segment | LoadStep] = []
    for sign in (1.0, -1.0):
        for share in (*_LEVELS, *reversed(_LEVELS[:-1])):
            steps += _locked(profile, 0.0, sign * share, _LEVEL_S)
    steps.append(LoadStep("take all loads off and release the wave generator", 0.0))
    return Block(
        "load levels",
        tuple(steps),
        "five levels of load, up and down, both signs, up to the rated torque with nothing moving: "
        "whether the reading bends with the cube of the load, at a knee or at a limit",
    )


def _load_nm(profile: ProfileData, share: float) -> float:
    """Return a load as a share of the rated torque within the limit, N m."""
    return _rounded(share * min(profile.drive.rated_torque_nm, profile.limits.torque_nm))


def _locked(profile: ProfileData, angle_rad: float, share: float, seconds: float) -> Steps:
    """Return a load on the locked drive, as a share of the rated torque, and its measurement."""
    torque = math.copysign(_load_nm(profile, abs(share)), share)
    side = "cw" if torque > 0.0 else "ccw"
    text = (
        f"lock the wave generator with the flexspline at {math.degrees(angle_rad):.1f} degrees "
        f"and load {abs(torque):g} N m {side}"
    )
    return (
        LoadStep(text, torque, locked=True, position_rad=angle_rad),
        Segment("rest", seconds, note="locked load"),
    )
