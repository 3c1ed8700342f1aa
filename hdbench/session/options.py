"""Options of an experiment, the task made of them, and its outcome."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from hdbench.devices.bench import Operator
from hdbench.devices.operator import Mistake
from hdbench.diagnosis.planning.segments import MotionPlan
from hdbench.evaluation import EvaluatedResult
from hdbench.filter import FilterModel
from hdbench.profile import Profile
from hdbench.records import TorqueScale
from hdbench.records.journal import JournalContent
from hdbench.records.runfolder import RunFolder
from hdbench.session.calibrating.conversation import Conversation
from hdbench.session.calibrating.plan import Preset
from hdbench.session.plans import Plan
from hdbench.session.recorder import Watcher
from hdbench.session.stop import StopSignals

Progress = Callable[[str, float], None]
"""Called with what is going on and the share done, 0 to 1."""


@dataclass(frozen=True, slots=True)
class BenchOptions:
    """How an experiment is to be run.

    Parameters
    ----------
    out : Path
        Parent folder of run folders.
    plant : str
        Plant of the embedded bench.
    seed : int
        Seed of the embedded bench.
    address : str or None
        Bench controller instead of the profile's.
    control : str or None
        Control channel of a simulated bench at `address`: a simulated operator sets lock and
        weights there. Its motor moves only with the answer of `operator`, like any other's.
    realtime : bool or None
        Keep real time on the embedded bench; None in a resumed run does as it did before.
    calibration : Path or None
        Calibration whose gain scales the torque.
    allow_expired : bool
        Use that calibration even where it is older than the profile allows.
    misalignment : Path or None
        Misalignment result whose output-order block joins the online filter.
    filter_name : str or None
        Filter model instead of the profile's.
    operator : Operator or None
        The person at a bench that has an address; the embedded one brings its own simulated one.
    motion : MotionPlan or None
        Content of a plan file that is run instead of the profile's motion.
    preset : {"report", "cg14"} or None
        Sequence of a calibration; None takes the profile's.
    talk : Conversation or None
        The person at a calibration; without one a simulated bench is calibrated by rule.
    rehearse : bool
        Ask that person at a simulated bench too, for practice.
    mistakes : tuple of Mistake
        What the operator of a simulated bench gets wrong.
    watcher : Watcher
        Who looks on while samples come.
    """

    out: Path
    plant: str = "as-modelled"
    seed: int = 0
    address: str | None = None
    control: str | None = None
    realtime: bool | None = False
    calibration: Path | None = None
    allow_expired: bool = False
    misalignment: Path | None = None
    filter_name: str | None = None
    operator: Operator | None = None
    motion: MotionPlan | None = None
    preset: Preset | None = None
    talk: Conversation | None = None
    rehearse: bool = False
    mistakes: tuple[Mistake, ...] = ()
    watcher: Watcher = field(default_factory=Watcher)


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """A finished run.

    Parameters
    ----------
    folder : RunFolder
        Where everything is kept.
    result : CalibrationResult, MisalignmentResult or RippleResult
        The result as result.json keeps it.
    doubts : tuple of str
        Reasons to doubt the data; with any, the command exits 6.
    """

    folder: RunFolder
    result: EvaluatedResult
    doubts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Task:
    """One run."""

    kind: str
    profile: Profile
    options: BenchOptions
    plan: Plan
    scale: TorqueScale
    model: FilterModel
    folder: RunFolder
    stop: StopSignals
    progress: Progress
    content: JournalContent | None = None
