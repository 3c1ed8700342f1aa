"""Plans: steps of an experiment as data, made of a profile or a plan file, within its limits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from hdbench.devices.bench import Operator
from hdbench.devices.feasibility import check_drives, check_pace, check_tables
from hdbench.diagnosis.planning import segments
from hdbench.diagnosis.planning.planfile import plan_to_dict
from hdbench.errors import UsageError
from hdbench.profile.schema import ProfileData, ReferenceWave
from hdbench.profile.waves import ReferenceProgram, reference_values

# a row of twelve channels is 96 bytes in the journal and some 200 in the trace; a point of a
# calibration has its raw samples beside it
_ROW_BYTES = 320
_POINT_BYTES = 64 << 10


Role = Literal["zero-check", "shunt", "preload", "reading"]
PREPARATIONS = ("zero-check", "shunt", "preload")
"""Roles whose readings prepare the calibration and are no part of its loads."""


@dataclass(frozen=True, slots=True)
class Point:
    """One load to put on, to wait for and to read."""

    number: int
    role: Role
    experiment: str
    position_rad: float
    range: str
    direction: str
    series: str
    mass_kg: float
    torque_nm: float
    step_nm: float
    read_after_s: float
    label: str
    position_index: int = 1
    position_count: int = 1
    repeat: int = 0

    @property
    def mounting(self) -> tuple[float, str]:
        """Position and direction: what stays untouched from one point to the next."""
        return self.position_rad, self.direction

    def describe(self) -> str:
        """Return the point in words."""
        if self.role == "zero-check":
            return f"{self.label}: no weight, bridge zero and range"
        if self.role == "shunt":
            return f"{self.label}: shunt resistor on, no weight"
        return (
            f"{self.label}: {self.mass_kg:g} kg {self.direction}, expect {self.torque_nm:+.3f} N m"
        )


@dataclass(frozen=True, slots=True)
class Lock:
    """Have the wave generator locked (or released) by the operator; drive disabled."""

    locked: bool

    def describe(self) -> str:
        """Return the step in words."""
        return "lock the wave generator" if self.locked else "release the wave generator"

    def ask(self, operator: Operator) -> bool:
        """Ask for it; True when confirmed."""
        return operator.confirm_lock(locked=self.locked)


@dataclass(frozen=True, slots=True)
class Place:
    """Have the flexspline brought to a position."""

    position_rad: float
    index: int
    count: int

    def describe(self) -> str:
        """Return the step in words."""
        return f"flexspline to {self.position_rad:.4f} rad (position {self.index} of {self.count})"

    def ask(self, operator: Operator) -> bool:
        """Ask for it; True when confirmed."""
        return operator.set_position(self.position_rad, index=self.index, count=self.count)


@dataclass(frozen=True, slots=True)
class Put:
    """Have a load put on (or taken off) that stays for what is recorded next."""

    load: segments.LoadStep
    mass_kg: float

    @property
    def direction(self) -> str:
        """``cw`` or ``ccw``."""
        return "ccw" if self.load.torque_nm < 0.0 else "cw"

    def describe(self) -> str:
        """Return the step in words."""
        return self.load.describe()

    def ask(self, operator: Operator) -> bool:
        """Ask for it; True when confirmed."""
        torque_nm, text = self.load.torque_nm, self.load.text
        return operator.hang(
            self.mass_kg, direction=self.direction, expected_nm=torque_nm, step=text
        )


@dataclass(frozen=True, slots=True)
class Acquire:
    """Run the reference generator and record samples."""

    wave: ReferenceWave | ReferenceProgram | None
    sample_period_s: float
    duration_s: float
    load: segments.LoadStep | None = None

    @property
    def n_samples(self) -> int:
        """Number of samples of the acquisition."""
        if isinstance(self.wave, ReferenceProgram):
            return self.wave.n_samples
        return round(self.duration_s / self.sample_period_s)

    @property
    def peak_v(self) -> float:
        """Bound of the reference's magnitude, V."""
        if isinstance(self.wave, ReferenceProgram):
            return self.wave.peak_v
        return 0.0 if self.wave is None else abs(self.wave.bias_v) + abs(self.wave.amplitude_v)

    def describe(self) -> str:
        """Return the step in words."""
        length = f"{self.duration_s:.1f} s, {self.n_samples} samples"
        if isinstance(self.wave, ReferenceProgram):
            return f"program of {len(self.wave.parts)} parts for {length}"
        return f"{'no' if self.wave is None else self.wave.wave} reference for {length}"


PLAN_NAME = "plan.json"
"""File of a run folder with what a resumed run needs: points of a calibration, or a plan file."""
Step = Lock | Place | Point | Put | Acquire


@dataclass(frozen=True, slots=True)
class Plan:
    """One experiment: steps in order and how long they take.

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment`` or ``ripple``.
    steps : tuple of Step
        What happens.
    duration_s : float
        Time the bench needs, s; the operator's own time is not in it.
    motion : MotionPlan or None
        The plan file that it was made from.
    preset : str or None
        Sequence of a calibration: ``report`` or ``cg14``.
    handling_s : float
        Estimate of the operator's own time, s; 0 where there is none.
    """

    kind: str
    steps: tuple[Step, ...]
    duration_s: float
    motion: segments.MotionPlan | None = None
    preset: str | None = None
    handling_s: float = 0.0

    @property
    def points(self) -> tuple[Point, ...]:
        """Loads of a calibration, in order."""
        return tuple(step for step in self.steps if isinstance(step, Point))

    @property
    def moves(self) -> bool:
        """Whether samples of a motion are recorded."""
        return any(isinstance(step, Acquire) for step in self.steps)

    @property
    def loads(self) -> tuple[Put, ...]:
        """Loads that a person puts on between acquisitions."""
        return tuple(step for step in self.steps if isinstance(step, Put))

    @property
    def stored_bytes(self) -> int:
        """Estimate of what the run stores, byte: journal and trace."""
        rows = sum(step.n_samples for step in self.steps if isinstance(step, Acquire))
        return _ROW_BYTES * rows + _POINT_BYTES * len(self.points)

    def lines(self) -> list[str]:
        """Return the steps in words, numbered; of a calibration only its points have numbers."""
        if self.points:
            return [
                f"{step.number if isinstance(step, Point) else '':3}  {step.describe()}"
                for step in self.steps
            ]
        return [f"{number:3d}  {step.describe()}" for number, step in enumerate(self.steps, 1)]

    def to_dict(self) -> dict[str, object]:
        """Return the plan as ``--dry-run`` prints it and run.json keeps it."""
        body: dict[str, object] = {
            "kind": self.kind,
            "duration_s": self.duration_s,
            "moves": self.moves,
            "steps": [step.describe() for step in self.steps],
        }
        if self.preset is not None:
            body |= {"preset": self.preset, "handling_s": self.handling_s}
        return body if self.motion is None else {**body, "motion": plan_to_dict(self.motion)}


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
        (Lock(locked=False), Acquire(run.reference, profile.daq.sample_period_s, run.duration_s)),
        run.duration_s,
    )


def motion_plan(kind: str, asked: segments.MotionPlan, profile: ProfileData) -> Plan:
    """Plan what a plan file asks for."""
    problems = segments.check_motion_plan(asked, profile)
    if problems:
        raise UsageError.several(problems)
    places = sorted({load.position_rad for load in asked.loads if load.locked})
    stages = {id(stage.load): stage for stage in segments.plan_stages(asked)}
    steps: list[Step] = []
    before: segments.LoadStep | None = None
    if id(None) in stages:
        steps = [Lock(locked=False), _acquire(stages[id(None)], profile, asked)]
        before = segments.LoadStep("no load", 0.0)
    for load in asked.loads:
        steps += _loading(load, before, places, profile)
        if id(load) in stages:
            steps.append(_acquire(stages[id(load)], profile, asked))
        before = load
    return Plan(kind, tuple(steps), asked.duration_s, asked)


def _loading(
    load: segments.LoadStep,
    before: segments.LoadStep | None,
    places: list[float],
    profile: ProfileData,
) -> list[Step]:
    """Return what the operator does for one load step after another."""
    steps: list[Step] = []
    if before is None or before.locked is not load.locked:
        steps.append(Lock(locked=load.locked))
    moved = before is None or not before.locked or before.position_rad != load.position_rad
    if load.locked and moved:
        steps.append(Place(load.position_rad, places.index(load.position_rad) + 1, len(places)))
    lever_nm_per_kg = profile.arm.gravity_m_s2 * profile.arm.length_m
    steps.append(Put(load, abs(load.torque_nm) / lever_nm_per_kg))
    return steps


def _acquire(stage: segments.Stage, profile: ProfileData, asked: segments.MotionPlan) -> Acquire:
    """Return what is recorded under one load."""
    program = segments.program_of(stage, profile)
    load = stage.load or segments.LoadStep("no load", 0.0)
    period_s = profile.daq.sample_period_s
    return Acquire(
        None if load.locked else program,
        period_s,
        program.n_samples * period_s,
        load if asked.loads else None,
    )


_ROUNDING = 1e-12


def check_plan(plan: Plan, profile: ProfileData) -> None:
    """Hold every step against the profile's limits; nothing has moved yet."""
    check_tables(profile)
    problems = [*_check_devices(plan, profile)]
    for number, step in enumerate(plan.steps, start=1):
        where = f"step {number} of the {plan.kind} plan"
        if isinstance(step, Acquire):
            problems += _check_motion(step, profile, where)
        elif isinstance(step, Point):
            problems += _check_load(step, profile, where)
    if problems:
        raise UsageError.several(problems)


def _check_devices(plan: Plan, profile: ProfileData) -> Iterator[UsageError]:
    """Ask whether something can move the motor, and whether devices and wires are fast enough."""
    acquired = [step for step in plan.steps if isinstance(step, Acquire)]
    moving = [step for step in acquired if step.wave is not None]
    checks = [partial(check_drives, profile, step.describe()) for step in moving[:1]]
    periods = {step.sample_period_s: step.describe() for step in acquired}
    if plan.points:
        periods[profile.calibration.sample_period_s] = "the calibration"
    checks += [partial(check_pace, profile, period_s, what) for period_s, what in periods.items()]
    for check in checks:
        try:
            check()
        except UsageError as error:
            yield error


def _check_load(point: Point, profile: ProfileData, where: str) -> Iterator[UsageError]:
    """Hold a load against the drive's limit and the converter's range."""
    limit_nm = profile.limits.torque_nm
    volts = abs(point.torque_nm) / profile.sensor.gain_nm_per_v
    if not abs(point.torque_nm) <= limit_nm:
        yield UsageError(
            f"{point.torque_nm:+.3f} N m is outside +-{limit_nm:g} N m",
            where=where,
            fix="use a lighter mass, or raise limits.torque_nm if the drive allows it",
        )
    elif not volts <= profile.daq.range_v:
        yield UsageError(
            f"{point.torque_nm:+.3f} N m would read {volts:.2f} V; the range ends at "
            f"{profile.daq.range_v:g} V",
            where=where,
            fix="use a lighter mass, or lower the amplifier's gain (and sensor.gain_nm_per_v)",
        )


def _travel_rad(step: Acquire, profile: ProfileData) -> float:
    """Return how far the motor gets from its start."""
    period_s = step.sample_period_s
    volts = reference_values(step.wave, period_s, step.duration_s)
    angle = np.cumsum(volts) * period_s * profile.servo.velocity_gain_rad_s_per_v
    return float(np.max(np.abs(angle), initial=0.0))


def _check_motion(step: Acquire, profile: ProfileData, where: str) -> Iterator[UsageError]:
    limits, peak_v = profile.limits, step.peak_v
    asked = [
        ("reference", peak_v, "reference_v", "V"),
        (
            "motor speed",
            peak_v * profile.servo.velocity_gain_rad_s_per_v,
            "velocity_rad_s",
            "rad/s",
        ),
        ("duration", step.duration_s, "duration_s", "s"),
    ]
    if limits.travel_rad is not None:
        asked.append(("travel", _travel_rad(step, profile), "travel_rad", "rad"))
    for name, value, key, unit in asked:
        limit = getattr(limits, key)
        # a speed at its limit comes back from volts with the rounding of a division
        if not value <= limit * (1.0 + _ROUNDING):
            yield UsageError(
                f"{name} {value:.6g} {unit} is above {limit:g} {unit}",
                where=where,
                fix=f"ask for less, or raise limits.{key} in the profile if the bench allows it",
            )
