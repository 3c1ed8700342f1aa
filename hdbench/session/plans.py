"""Experiments as data: what will happen, in order, before anything does."""

from __future__ import annotations

import math
from dataclasses import dataclass

from hdbench.diagnosis.planning.planfile import plan_to_dict
from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan
from hdbench.errors import UsageError
from hdbench.model.program import ReferenceProgram
from hdbench.profile.schema import ProfileData, ReferenceWave

__all__ = [
    "Acquire",
    "Hang",
    "Lock",
    "Place",
    "Plan",
    "Put",
    "Step",
    "calibration_plan",
    "check_plan",
    "misalignment_plan",
    "ripple_plan",
]


@dataclass(frozen=True, slots=True)
class Lock:
    """Have the wave generator locked (or released) by the operator; drive disabled.

    Parameters
    ----------
    locked : bool
        True to lock, False to release.
    """

    locked: bool

    def describe(self) -> str:
        """Return the step in words."""
        return "lock the wave generator" if self.locked else "release the wave generator"


@dataclass(frozen=True, slots=True)
class Place:
    """Have the flexspline brought to a position.

    Parameters
    ----------
    position_rad : float
        Flexspline position, rad.
    index, count : int
        Number of the position, from 1, and how many there are.
    """

    position_rad: float
    index: int
    count: int

    def describe(self) -> str:
        """Return the step in words."""
        return f"flexspline to {self.position_rad:.4f} rad (position {self.index} of {self.count})"


@dataclass(frozen=True, slots=True)
class Hang:
    """Have a weight hung, wait until the reading has settled, average, record.

    Parameters
    ----------
    experiment : str
        Identifier of the loading experiment.
    position_rad : float
        Flexspline position, rad.
    range, direction, series : str
        As in the loads file.
    mass_kg : float
        Mass on the arm, kg.
    torque_nm : float
        Torque expected of it, N m; cw positive.
    label : str
        The step in words.
    """

    experiment: str
    position_rad: float
    range: str
    direction: str
    series: str
    mass_kg: float
    torque_nm: float
    label: str

    def describe(self) -> str:
        """Return the step in words."""
        return (
            f"{self.label}: {self.mass_kg:g} kg {self.direction}, expect {self.torque_nm:+.3f} N m"
        )


@dataclass(frozen=True, slots=True)
class Put:
    """Have a load put on (or taken off) that stays for what is recorded next.

    Parameters
    ----------
    load : LoadStep
        What the operator is told, and the torque.
    mass_kg : float
        Mass on the profile's arm that gives this torque, kg.
    """

    load: LoadStep
    mass_kg: float

    @property
    def direction(self) -> str:
        """``cw`` or ``ccw``."""
        return "ccw" if self.load.torque_nm < 0.0 else "cw"

    def describe(self) -> str:
        """Return the step in words."""
        return self.load.describe()


@dataclass(frozen=True, slots=True)
class Acquire:
    """Run the reference generator and record samples.

    Parameters
    ----------
    wave : ReferenceWave, ReferenceProgram or None
        Motor reference, V; None with the wave generator locked and the drive disabled.
    sample_period_s : float
        Sampling period, s.
    duration_s : float
        Length, s.
    load : LoadStep or None
        Load that is on meanwhile; None where the plan has no loads.
    """

    wave: ReferenceWave | ReferenceProgram | None
    sample_period_s: float
    duration_s: float
    load: LoadStep | None = None

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


_ROUNDING = 1e-12
_RAMP_SHARE = 4.0  # ramps last four times as long as the servo at its limit would need

Step = Lock | Place | Hang | Put | Acquire


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
    """

    kind: str
    steps: tuple[Step, ...]
    duration_s: float
    motion: MotionPlan | None = None

    @property
    def moves(self) -> bool:
        """Whether samples of a motion are recorded."""
        return any(isinstance(step, Acquire) for step in self.steps)

    @property
    def loads(self) -> tuple[Put, ...]:
        """Loads that a person puts on between acquisitions."""
        return tuple(step for step in self.steps if isinstance(step, Put))

    def to_dict(self) -> dict[str, object]:
        """Return the plan as ``--dry-run`` prints it and run.json keeps it."""
        body: dict[str, object] = {
            "kind": self.kind,
            "duration_s": self.duration_s,
            "moves": self.moves,
            "steps": [step.describe() for step in self.steps],
        }
        return body if self.motion is None else {**body, "motion": plan_to_dict(self.motion)}


def calibration_plan(profile: ProfileData) -> Plan:
    """Plan positions x directions x ranges, each loaded and unloaded.

    Parameters
    ----------
    profile : ProfileData
        The bench.

    Returns
    -------
    Plan
        Weights go up through the range's masses and down again; the heaviest is read once.
    """
    plan = profile.calibration
    steps: list[Step] = [Lock(locked=True)]
    for index in range(plan.positions):
        position_rad = 2.0 * math.pi * index / plan.positions
        steps.append(Place(position_rad, index + 1, plan.positions))
        for direction in plan.directions:
            for load_range in plan.ranges:
                steps.extend(_loading(profile, index, position_rad, direction, load_range))
    readings = sum(isinstance(step, Hang) for step in steps)
    return Plan("calibration", tuple(steps), readings * 2.0 * plan.average_s)


def _loading(
    profile: ProfileData, index: int, position_rad: float, direction: str, load_range: str
) -> list[Hang]:
    masses = (
        profile.calibration.low_masses_kg
        if load_range == "low"
        else profile.calibration.full_masses_kg
    )
    up = sorted(masses)
    sequence = [("up", mass) for mass in up] + [("down", mass) for mass in reversed(up[:-1])]
    sign = 1.0 if direction == "cw" else -1.0
    experiment = f"p{index + 1}-{direction}-{load_range}"
    return [
        Hang(
            experiment=experiment,
            position_rad=position_rad,
            range=load_range,
            direction=direction,
            series=series,
            mass_kg=mass,
            torque_nm=sign * mass * profile.arm.gravity_m_s2 * profile.arm.length_m,
            label=f"{experiment} {number} of {len(sequence)} ({series})",
        )
        for number, (series, mass) in enumerate(sequence, start=1)
    ]


def misalignment_plan(profile: ProfileData) -> Plan:
    """Plan a constant velocity over the profile's output turns, one direction after the other.

    Parameters
    ----------
    profile : ProfileData
        The bench.

    Returns
    -------
    Plan
        One acquisition: a trapezoid reference of one period, so that the angle runs on through the
        reversal. Its ramps ask for a quarter of the servo's acceleration: a jump of the reference
        would be a jump of the inertial torque, which no differentiator follows.
    """
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
    """Plan the free motion with the profile's reference generator.

    Parameters
    ----------
    profile : ProfileData
        The bench.

    Returns
    -------
    Plan
        One acquisition.
    """
    run = profile.ripple
    return Plan(
        "ripple",
        (
            Lock(locked=False),
            Acquire(run.reference, profile.daq.sample_period_s, run.duration_s),
        ),
        run.duration_s,
    )


def check_plan(plan: Plan, profile: ProfileData) -> None:
    """Hold every step against the profile's limits; nothing has moved yet.

    Parameters
    ----------
    plan : Plan
        What is asked for.
    profile : ProfileData
        The bench.

    Raises
    ------
    UsageError
        With every step that is outside a limit.
    """
    problems: list[UsageError] = []
    for number, step in enumerate(plan.steps, start=1):
        where = f"step {number} of the {plan.kind} plan"
        if isinstance(step, Acquire):
            problems.extend(_check_motion(step, profile, where))
        elif isinstance(step, Hang) and not abs(step.torque_nm) <= profile.limits.torque_nm:
            problems.append(
                UsageError(
                    f"{step.torque_nm:+.3f} N m is outside +-{profile.limits.torque_nm:g} N m",
                    where=where,
                    fix="use a lighter mass, or raise limits.torque_nm if the drive allows it",
                )
            )
    if problems:
        raise UsageError(
            problems[0].what, where=problems[0].where, fix=problems[0].fix, problems=tuple(problems)
        )


def _check_motion(step: Acquire, profile: ProfileData, where: str) -> list[UsageError]:
    peak_v = step.peak_v
    velocity = peak_v * profile.servo.velocity_gain_rad_s_per_v
    limits = profile.limits
    asked = (
        ("reference", peak_v, limits.reference_v, "V", "reference_v"),
        ("motor speed", velocity, limits.velocity_rad_s, "rad/s", "velocity_rad_s"),
        ("duration", step.duration_s, limits.duration_s, "s", "duration_s"),
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
