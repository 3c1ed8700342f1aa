"""What building blocks of a protocol are made of: ramps and steady speeds from rest to rest."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan, Segment
from hdbench.profile.schema import ProfileData

__all__ = ["Block", "ramp", "rounded", "runs"]

# ramps stay this far below the servo's acceleration: a servo at its limit does not follow
_RAMP_SHARE = 0.25
# no ramp is shorter: the servo's lag and the window of the acceleration are behind it then
_SHORTEST_RAMP_S = 0.5


@dataclass(frozen=True, slots=True)
class Block:
    """A building block.

    Parameters
    ----------
    name : str
        What it is.
    steps : tuple of Segment or LoadStep
        From rest to rest.
    shows : str
        What it tells apart and why, in words.
    """

    name: str
    steps: tuple[Segment | LoadStep, ...]
    shows: str

    @property
    def duration_s(self) -> float:
        """Length, s."""
        return MotionPlan(self.name, self.steps).duration_s

    @property
    def needs_operator(self) -> bool:
        """Whether a person has to do something."""
        return any(isinstance(step, LoadStep) for step in self.steps)


def ramp(profile: ProfileData, before: float, after: float) -> Segment:
    """Return a ramp within a quarter of the servo's acceleration, in tenths of a second.

    Parameters
    ----------
    profile : ProfileData
        Servo.
    before, after : float
        Speeds, rad/s.

    Returns
    -------
    Segment
    """
    needed = abs(after - before) / (_RAMP_SHARE * profile.servo.max_acceleration_rad_s2)
    return Segment("ramp", max(_SHORTEST_RAMP_S, math.ceil(10.0 * needed) / 10.0), after)


def runs(
    profile: ProfileData, speeds: tuple[float, ...], steady_s: float, note: str
) -> tuple[Segment, ...]:
    """Return speeds one after the other, from rest to rest.

    Parameters
    ----------
    profile : ProfileData
        Servo.
    speeds : tuple of float
        Speeds, rad/s.
    steady_s : float
        How long each is kept, s.
    note : str
        What it is for.

    Returns
    -------
    tuple of Segment
    """
    before, steps = 0.0, list[Segment]()
    for speed in speeds:
        steps.append(ramp(profile, before, speed))
        steps.append(Segment("hold", steady_s, speed, note=note))
        before = speed
    return (*steps, ramp(profile, before, 0.0))


def rounded(value: float) -> float:
    """Return a value with three digits.

    Parameters
    ----------
    value : float
        Any value.

    Returns
    -------
    float
    """
    return float(f"{value:.3g}")
