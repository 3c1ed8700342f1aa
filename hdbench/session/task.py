"""One run as it is handed from the one who plans it to the one who walks it."""

from __future__ import annotations

from dataclasses import dataclass

from hdbench.filter import FilterModel
from hdbench.profile import Profile
from hdbench.records import TorqueScale
from hdbench.records.journal import JournalContent
from hdbench.records.runfolder import RunFolder
from hdbench.session.options import BenchOptions
from hdbench.session.plans import Plan
from hdbench.session.runner import Progress
from hdbench.session.stop import StopSignals

__all__ = ["Task"]


@dataclass(frozen=True, slots=True)
class Task:
    """One run.

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment`` or ``ripple``.
    profile : Profile
        The bench.
    options : BenchOptions
        How to run it.
    plan : Plan
        A plan within the limits.
    scale : TorqueScale
        Gain of the torque.
    model : FilterModel
        Filter that runs online.
    folder : RunFolder
        Where everything is kept.
    stop : StopSignals
        Signals that end the run.
    progress : callable
        Told what is going on.
    content : JournalContent or None
        Journal of earlier sessions of this run; None for a new one.
    """

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
