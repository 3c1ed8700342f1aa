"""Building blocks that need an operator: loads while the motor turns, and while it is locked."""

from __future__ import annotations

import math

from hdbench.diagnosis.planning.blockparts import Block, rounded, runs
from hdbench.diagnosis.planning.segments import LoadStep, Segment
from hdbench.profile.schema import ProfileData

__all__ = ["load_levels", "locked_loads", "under_load"]

_LOAD_SHARES = (0.3, 0.6)
_LOCKED_PLACES = 4
_LOCKED_S = 4.0
# two levels of each sign fix the size and the bend of any curve over the load, more test its law
_LEVELS = (0.2, 0.4, 0.6, 0.8, 1.0)
_LEVEL_S = 3.0


def under_load(profile: ProfileData, speed: float) -> Block:
    """Return motion under constant loads of both signs.

    Parameters
    ----------
    profile : ProfileData
        Bench.
    speed : float
        Speed, rad/s.

    Returns
    -------
    Block
    """
    speed = rounded(min(speed, 100.0))
    steps: list[Segment | LoadStep] = []
    for share in _LOAD_SHARES:
        torque = _load_nm(profile, share)
        for sign, side in ((1.0, "cw"), (-1.0, "ccw")):
            text = (
                f"hang a load of {torque:g} N m on the {side} side by a rope over a drum, "
                "so that it stays the same while the output turns"
            )
            steps.append(LoadStep(text, sign * torque))
            steps += runs(profile, (speed, -speed), 4.0, "motion under load")
    steps.append(LoadStep("take all loads off", 0.0))
    return Block(
        "moving under load",
        tuple(steps),
        "the same motion under loads of both signs: what grows with the load's size, with its "
        "sign, or not at all",
    )


def _load_nm(profile: ProfileData, share: float) -> float:
    """Return a load as a share of the rated torque within the limit, N m."""
    return rounded(share * min(profile.drive.rated_torque_nm, profile.limits.torque_nm))


def locked_loads(profile: ProfileData) -> Block:
    """Return loads at several output angles with the wave generator locked.

    Parameters
    ----------
    profile : ProfileData
        Bench.

    Returns
    -------
    Block
    """
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


def load_levels(profile: ProfileData) -> Block:
    """Return loads of many levels at one output angle with the wave generator locked.

    Parameters
    ----------
    profile : ProfileData
        Bench.

    Returns
    -------
    Block
    """
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


def _locked(
    profile: ProfileData, angle_rad: float, share: float, seconds: float
) -> tuple[LoadStep, Segment]:
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
