"""Motion plan: segments of speed, steps of the operator, the motion it gives, and its limits."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from operator import attrgetter

import numpy as np

from hdbench.errors import UsageError
from hdbench.model import Motion, motion_from_trace
from hdbench.profile.schema import ProfileData
from hdbench.profile.waves import MAX_PARTS, ProgramPart, ReferenceProgram, program_voltage
from hdbench.records.trace import FloatArray, Trace

# numbers travel as 32-bit floats and are sums of a few terms of a file: a limit, a cycle or an
# equal speed that is given with few digits is meant to be met
_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Segment:
    """One stretch of motor speed."""

    # hold (speed kept), ramp (linear from the speed before to `speed_rad_s`), sine (about the speed
    # before), sweep (linear to `speed_rad_s` and back) or rest
    kind: str
    duration_s: float  # above 0
    # kept by a hold, reached by a ramp, turned round at by a sweep, amplitude of a sine
    speed_rad_s: float = 0.0
    frequency_hz: float = 0.0  # of a sine, whose cycles in `duration_s` have to be whole
    note: str = ""  # what it is for

    def end_speed_rad_s(self, before_rad_s: float) -> float:
        """Return the speed at its end, rad/s, for the speed before it."""
        return self.speed_rad_s if self.kind == "ramp" else before_rad_s


@dataclass(frozen=True, slots=True)
class LoadStep:
    """What the operator does while the motor stands; it holds until the next load step."""

    text: str
    torque_nm: float  # on the output from then on; 0 takes all load off
    locked: bool = False  # whether the wave generator is locked; then only rests may follow
    position_rad: float = 0.0  # of the flexspline while locked

    def describe(self) -> str:
        """Return the step in words."""
        return f"operator: {self.text}"


@dataclass(frozen=True, slots=True)
class MotionPlan:
    """A run, or a block of one: segments in order, from rest to rest."""

    name: str
    steps: tuple[Segment | LoadStep, ...]
    purpose: str = ""  # why it is done, in words

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


def planned_trace(plan: MotionPlan, profile: ProfileData) -> Trace:
    """Return the record of a plan within the limits that a bench without noise would measure."""
    period = profile.daq.sample_period_s
    count = plan.duration_s / period
    # more do not fit a gigabyte with everything that is computed from them
    most = 2_000_000
    if not 5.0 <= count <= most:
        raise UsageError(
            f"{count:.6g} samples in the plan; needed: 5 to {most}",
            where="the plan",
            fix="change its duration",
        )
    start_s, angle = 0.0, 0.0
    pieces: list[dict[str, FloatArray]] = []
    for stage in plan_stages(plan):
        piece = _stage_columns(stage, profile, start_s, angle)
        pieces.append(piece)
        # a person takes a minute to hang a weight and step back; only slow effects notice it
        start_s = float(piece["time_s"][-1]) + period + 60.0
        if not (stage.load is not None and stage.load.locked):
            angle = float(piece["motor_angle_rad"][-1])
    columns = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    return Trace(columns, f"plan {plan.name}")


def planned_motion(plan: MotionPlan, profile: ProfileData) -> Motion:
    """Return the motion of a plan, formed as for a measured record."""
    return motion_from_trace(planned_trace(plan, profile), profile)


def _stage_columns(
    stage: Stage, profile: ProfileData, start_s: float, angle_rad: float
) -> dict[str, FloatArray]:
    """Return the columns of one acquisition that starts at a time and a motor angle."""
    period, ratio, servo = profile.daq.sample_period_s, profile.drive.gear_ratio, profile.servo
    volts = program_voltage(program_of(stage, profile), period)
    velocity, travelled = _servo(profile, volts)
    # a locked output stands at the step's position, the motor at N times that; the current is that
    # of a motor without friction
    angle, torque, held = angle_rad + travelled, 0.0, 0.0
    if stage.load is not None:
        torque = stage.load.torque_nm
        if stage.load.locked:
            angle = np.full(len(volts), ratio * stage.load.position_rad)
        else:
            held = torque / (ratio * servo.torque_constant_nm_per_a)
    per_acceleration = servo.max_current_a / servo.max_acceleration_rad_s2
    return {
        "time_s": start_s + period * np.arange(len(volts), dtype=np.float64),
        "reference_v": volts,
        "motor_velocity_rad_s": velocity,
        "motor_angle_rad": angle,
        "output_angle_rad": angle / ratio,
        "load_torque_nm": np.full(len(volts), torque),
        "motor_current_a": per_acceleration * np.gradient(velocity, period) + held,
    }


def _servo(profile: ProfileData, volts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return velocity, rad/s, and angle travelled, rad, at every sample."""
    # d velocity/dt = clip(2 pi bandwidth (wanted - velocity), +-greatest acceleration), solved in
    # closed form over every period but the one in which the limit is left
    period, servo = profile.daq.sample_period_s, profile.servo
    rate, most = 2.0 * math.pi * servo.bandwidth_hz, servo.max_acceleration_rad_s2
    reached = -math.expm1(-rate * period)
    velocity, angle = list[float](), list[float]()
    now, turned = 0.0, 0.0
    for wanted in (servo.velocity_gain_rad_s_per_v * volts).tolist():
        velocity.append(now)
        angle.append(turned)
        away = wanted - now
        if abs(away) * rate <= most:
            turned += wanted * period - away * reached / rate
            now += reached * away
        else:
            step = math.copysign(min(most * period, abs(away)), away)
            turned += (now + 0.5 * step) * period
            now += step
    return np.array(velocity), np.array(angle)


def check_motion_plan(plan: MotionPlan, profile: ProfileData) -> list[UsageError]:
    """Return every way in which a plan leaves what the bench may do; empty where it does not.

    Speed, acceleration, reference volts, torque, duration, jumps of the speed, motion while locked,
    no rest at the end, more parts than a node keeps. NaN fails every comparison.
    """
    check = _Check(profile, "")
    speed, locked = 0.0, False
    for number, step in enumerate(plan.steps, start=1):
        check.where = f"step {number} of the plan"
        if isinstance(step, LoadStep):
            locked = step.locked
            fix = "use a lighter weight"
            check.limit("torque", abs(step.torque_nm), "N m", "limits.torque_nm", fix)
            what = f"a load step at {speed:g} rad/s; needed: the motor at rest"
            check.need(abs(speed) <= _ROUNDING, what, "put a ramp to 0 before it")
        else:
            check.segment(step, speed, locked)
            speed = step.end_speed_rad_s(speed)
    check.where = "the plan"
    check.limit("duration", plan.duration_s, "s", "limits.duration_s")
    check.need(bool(plan.segments), "no segment; needed: at least one", "add a segment")
    what = f"the plan ends at {speed:g} rad/s; needed: rest"
    check.need(abs(speed) <= _ROUNDING, what, "end it with a ramp to 0")
    counts = [sum(1 + (s.kind == "sweep") for s in stage.segments) for stage in plan_stages(plan)]
    parts = max(counts, default=0)
    what = f"{parts} parts without a load step between them; needed: at most {MAX_PARTS}"
    check.need(parts <= MAX_PARTS, what, "use fewer segments")
    return check.problems


@dataclass(slots=True)
class _Check:
    """Collects what is wrong at one place after the other."""

    profile: ProfileData
    where: str
    problems: list[UsageError] = field(default_factory=list)

    def need(self, good: bool, what: str, fix: str) -> None:
        if not good:
            self.problems.append(UsageError(what, where=self.where, fix=fix))

    def limit(
        self, name: str, value: float, unit: str, key: str, fix: str = "ask for less"
    ) -> None:
        limit = float(attrgetter(key)(self.profile))
        what = f"{name} {value:.6g} {unit} is above {limit:g} {unit}"
        good = value <= limit * (1.0 + _ROUNDING)
        self.need(good, what, f"{fix}; the profile's limit is {key}")

    def segment(self, segment: Segment, before: float, locked: bool) -> None:
        kind, target, length = segment.kind, segment.speed_rad_s, segment.duration_s
        # unlike max() this hands a NaN on
        peak, acceleration = float(np.maximum(abs(before), abs(target))), 0.0
        if kind == "sine":
            peak = abs(before) + abs(target)
            acceleration = 2.0 * math.pi * segment.frequency_hz * abs(target)
        elif kind in ("ramp", "sweep"):
            acceleration = (1.0 if kind == "ramp" else 2.0) * abs(target - before) / length
        volts = peak / self.profile.servo.velocity_gain_rad_s_per_v
        self.limit("motor speed", peak, "rad/s", "limits.velocity_rad_s")
        self.limit("reference", volts, "V", "limits.reference_v")
        self.limit("acceleration", acceleration, "rad/s^2", "servo.max_acceleration_rad_s2")
        expected = 0.0 if kind == "rest" else target
        jump = kind in ("hold", "rest") and not abs(before - expected) <= _ROUNDING
        what = f"a {kind} at {expected:g} rad/s after {before:g} rad/s is a jump"
        self.need(not jump, what, "put a ramp before it")
        cycles = segment.frequency_hz * length
        whole = float(np.rint(cycles))
        what = f"{cycles:.6g} cycles of a sine; needed: a whole number"
        fix = f"let it last {max(1.0, whole) / (segment.frequency_hz or 1.0):.6g} s"
        self.need(kind != "sine" or abs(cycles - whole) <= _ROUNDING, what, fix)
        period = self.profile.daq.sample_period_s
        what = f"duration {length:g} s is below one sampling period"
        self.need(length >= period, what, f"let it last {period:g} s or more")
        fix = "let only rests follow a locked load, or release the lock first"
        self.need(not locked or kind == "rest", f"{kind} with the wave generator locked", fix)
