"""The three experiments: planned, run, kept, evaluated."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hdbench.diagnosis.planning.segments import MotionPlan
from hdbench.filter import kernel_name
from hdbench.profile import Profile
from hdbench.profile.scaling import profile_scale, read_calibration
from hdbench.records.runfolder import RunFolder
from hdbench.session.filters import choose_filter
from hdbench.session.keeping import Run
from hdbench.session.motionplans import motion_plan
from hdbench.session.options import BenchOptions, RunOutcome
from hdbench.session.plans import (
    Plan,
    calibration_plan,
    check_plan,
    misalignment_plan,
    ripple_plan,
)
from hdbench.session.runner import Progress
from hdbench.session.stop import listen

__all__ = ["make_plan", "run_experiment"]

_PLANS: dict[str, Callable[..., Plan]] = {
    "calibration": calibration_plan,
    "misalignment": misalignment_plan,
    "ripple": ripple_plan,
}


def make_plan(kind: str, profile: Profile, motion: MotionPlan | None = None) -> Plan:
    """Plan an experiment and hold it against the profile's limits.

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment`` or ``ripple``.
    profile : Profile
        The bench.
    motion : MotionPlan or None
        Content of a plan file to run instead of the profile's motion.

    Returns
    -------
    Plan
        A plan within the limits.

    Raises
    ------
    UsageError
        If a step is outside a limit.
    """
    data = profile.data
    plan = _PLANS[kind](data) if motion is None else motion_plan(kind, motion, data)
    check_plan(plan, profile.data)
    return plan


def run_experiment(
    kind: str, profile: Profile, options: BenchOptions, progress: Progress
) -> RunOutcome:
    """Measure, keep and evaluate one experiment.

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment`` or ``ripple``.
    profile : Profile
        The bench.
    options : BenchOptions
        How to run it.
    progress : callable
        Told what is going on.

    Returns
    -------
    RunOutcome
        The complete run.

    Raises
    ------
    Stopped
        When a signal ended it; the safe state was confirmed, the run is kept.
    UnsafeError
        When the safe state could not be confirmed.
    DeviceError, StorageError, Aborted
        When the device, the disk, the operator or a limit ended it; the run is kept.
    """
    plan = make_plan(kind, profile, options.motion)
    scale = read_calibration(options.calibration) if options.calibration else profile_scale(profile)
    model = choose_filter(profile, options.filter_name, misalignment=options.misalignment)
    with listen() as stop:
        folder = RunFolder.create(
            options.out, kind=kind, profile=profile, details=_details(plan, options)
        )
        versions = {**folder.manifest["versions"], "kernel": kernel_name()}
        folder.update(calibration=scale.to_dict(), filter=model.to_dict(), versions=versions)
        run = Run(kind, profile, options, plan, scale, model, folder, stop, progress)
        run.measure()
        return run.evaluate()


def _details(plan: Plan, options: BenchOptions) -> dict[str, Any]:
    return {
        "plan": plan.to_dict(),
        "simulation": {"plant": options.plant, "seed": options.seed},
    }
