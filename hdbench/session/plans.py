"""Plans: steps of an experiment as data, in order."""

from __future__ import annotations

from dataclasses import dataclass

from hdbench.diagnosis.planning.planfile import plan_to_dict
from hdbench.diagnosis.planning.segments import LoadStep, MotionPlan
from hdbench.model.waves import ReferenceProgram
from hdbench.profile.schema import ReferenceWave
from hdbench.session.calibrating.points import Point

# a row of twelve channels is 96 bytes in the journal and some 200 in the trace; a point of a
# calibration has its raw samples beside it
_ROW_BYTES = 320
_POINT_BYTES = 64 << 10


@dataclass(frozen=True, slots=True)
class Lock:
    """Have the wave generator locked (or released) by the operator; drive disabled."""

    locked: bool

    def describe(self) -> str:
        """Return the step in words."""
        return "lock the wave generator" if self.locked else "release the wave generator"


@dataclass(frozen=True, slots=True)
class Place:
    """Have the flexspline brought to a position."""

    position_rad: float
    index: int
    count: int

    def describe(self) -> str:
        """Return the step in words."""
        return f"flexspline to {self.position_rad:.4f} rad (position {self.index} of {self.count})"


@dataclass(frozen=True, slots=True)
class Put:
    """Have a load put on (or taken off) that stays for what is recorded next."""

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
    """Run the reference generator and record samples."""

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
    motion: MotionPlan | None = None
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
