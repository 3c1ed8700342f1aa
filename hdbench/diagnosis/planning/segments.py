"""A motion plan as data: segments of motor speed, and what the operator does between them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hdbench.model.program import ProgramPart, ReferenceProgram
from hdbench.profile.schema import ProfileData

__all__ = ["LoadStep", "MotionPlan", "Segment", "Stage", "plan_stages", "program_of"]


@dataclass(frozen=True, slots=True)
class Segment:
    """One stretch of motor speed.

    Parameters
    ----------
    kind : str
        ``hold`` (speed kept), ``ramp`` (linear from the speed before to `speed_rad_s`), ``sine``
        (a sine about the speed before), ``sweep`` (linear to `speed_rad_s` and back), ``rest``.
    duration_s : float
        Length, s, above 0.
    speed_rad_s : float
        Motor speed, rad/s: kept by a hold, reached by a ramp, turned round at by a sweep, amplitude
        of a sine; 0 for a rest.
    frequency_hz : float
        Frequency of a sine, Hz; its cycles in `duration_s` have to be whole. 0 for all others.
    note : str
        What it is for.
    """

    kind: str
    duration_s: float
    speed_rad_s: float = 0.0
    frequency_hz: float = 0.0
    note: str = ""

    def end_speed_rad_s(self, before_rad_s: float) -> float:
        """Return the speed at its end, rad/s, for the speed before it."""
        return self.speed_rad_s if self.kind == "ramp" else before_rad_s


@dataclass(frozen=True, slots=True)
class LoadStep:
    """What the operator does while the motor stands; it holds until the next load step.

    Parameters
    ----------
    text : str
        What to do, in words.
    torque_nm : float
        Torque on the output from then on, N m; 0 takes all load off.
    locked : bool
        Whether the wave generator is locked; then only rests may follow.
    position_rad : float
        Position of the flexspline while locked, rad.
    """

    text: str
    torque_nm: float
    locked: bool = False
    position_rad: float = 0.0

    def describe(self) -> str:
        """Return the step in words."""
        return f"operator: {self.text}"


@dataclass(frozen=True, slots=True)
class MotionPlan:
    """A run, or a block of one: segments in order, from rest to rest.

    Parameters
    ----------
    name : str
        Its name.
    steps : tuple of Segment or LoadStep
        What happens, in order; the motor stands at the start and at the end.
    purpose : str
        Why it is done, in words.
    """

    name: str
    steps: tuple[Segment | LoadStep, ...]
    purpose: str = ""

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The stretches of motion."""
        return tuple(step for step in self.steps if isinstance(step, Segment))

    @property
    def loads(self) -> tuple[LoadStep, ...]:
        """What needs an operator."""
        return tuple(step for step in self.steps if isinstance(step, LoadStep))

    @property
    def duration_s(self) -> float:
        """Time that the bench samples, s; the operator's own time is not in it."""
        return math.fsum(segment.duration_s for segment in self.segments)

    @property
    def needs_operator(self) -> bool:
        """Whether a person has to do something at the bench."""
        return bool(self.loads)


@dataclass(frozen=True, slots=True)
class Stage:
    """One acquisition: its load, None before the first load step, and segments without a pause."""

    load: LoadStep | None
    segments: tuple[Segment, ...]


def plan_stages(plan: MotionPlan) -> tuple[Stage, ...]:
    """Return a plan as acquisitions; a load step without segments after it has none."""
    stages: list[Stage] = []
    load: LoadStep | None = None
    held: list[Segment] = []
    for step in (*plan.steps, LoadStep("end", 0.0)):
        if isinstance(step, Segment):
            held.append(step)
            continue
        if held:
            stages.append(Stage(load, tuple(held)))
        load, held = step, []
    return tuple(stages)


def program_of(stage: Stage, profile: ProfileData) -> ReferenceProgram:
    """Return the reference generator's program of a stage that `check_motion_plan` accepts."""
    gain, period = profile.servo.velocity_gain_rad_s_per_v, profile.daq.sample_period_s
    speed, parts = 0.0, list[ProgramPart]()
    for segment in stage.segments:
        n = max(1, round(segment.duration_s / period))
        start, target = speed / gain, segment.speed_rad_s / gain
        match segment.kind:
            case "ramp":
                parts.append(ProgramPart(n, start, target))
            case "sweep":
                half = max(1, n // 2)
                parts.append(ProgramPart(half, start, target))
                parts.append(ProgramPart(max(1, n - half), target, start))
            case "sine":
                f = segment.frequency_hz
                parts.append(ProgramPart(n, start, start, target, f, f))
            case _:
                parts.append(ProgramPart(n, start, start))
        speed = segment.end_speed_rad_s(speed)
    return ReferenceProgram(tuple(parts))
