"""Experiments: planned, run, kept, evaluated."""

from __future__ import annotations

from typing import Any

from hdbench.diagnosis.planning.planfile import write_plan
from hdbench.diagnosis.planning.segments import MotionPlan
from hdbench.filter import kernel_name
from hdbench.profile import Profile
from hdbench.profile.scaling import checked_age, profile_scale, read_calibration
from hdbench.records import TorqueScale
from hdbench.records.runfolder import RunFolder, utc_now
from hdbench.records.storage import keep_reserve
from hdbench.session.calibrating.plan import Preset, calibration_plan
from hdbench.session.calibrating.points import PLAN_NAME, write_points
from hdbench.session.filters import choose_filter
from hdbench.session.options import BenchOptions, RunOutcome, Task
from hdbench.session.planning import check_plan, misalignment_plan, motion_plan, ripple_plan
from hdbench.session.plans import Plan
from hdbench.session.run import Run, kept
from hdbench.session.runner import Progress
from hdbench.session.stop import listen


def make_plan(
    kind: str,
    profile: Profile,
    motion: MotionPlan | None = None,
    *,
    preset: Preset | None = None,
) -> Plan:
    """Plan an experiment and hold it against the profile's limits.

    Parameters
    ----------
    kind : str
        ``calibration``, ``misalignment`` or ``ripple``.
    profile : Profile
        The bench.
    motion : MotionPlan or None
        Content of a plan file to run instead of the profile's motion.
    preset : {"report", "cg14"} or None
        Sequence of a calibration; None takes the profile's.

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
    if kind == "calibration":
        plan = calibration_plan(data, preset)
    elif motion is not None:
        plan = motion_plan(kind, motion, data)
    else:
        plan = misalignment_plan(data) if kind == "misalignment" else ripple_plan(data)
    check_plan(plan, data)
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
    DataError
        When the calibration named has expired; nothing has moved.
    DeviceError, StorageError, Aborted
        When the device, the disk, the operator or a limit ended it; the run is kept.
    """
    plan = make_plan(kind, profile, options.motion, preset=options.preset)
    scale = _scale(profile, options)
    model = choose_filter(profile, options.filter_name, misalignment=options.misalignment)
    with listen() as stop:
        folder = RunFolder.create(
            options.out, kind=kind, profile=profile, details=_details(plan, options)
        )
        with kept(folder):
            keep_reserve(folder.path)
            versions = {**folder.manifest["versions"], "kernel": kernel_name()}
            folder.update(calibration=scale.to_dict(), filter=model.to_dict(), versions=versions)
            _keep_plan(folder, plan)
            run = Run(Task(kind, profile, options, plan, scale, model, folder, stop, progress))
            run.measure()
            return run.evaluate()


def _scale(profile: Profile, options: BenchOptions) -> TorqueScale:
    """Return the gain of a run; an expired calibration ends it before anything moves."""
    if options.calibration is None:
        return profile_scale(profile)
    return checked_age(
        read_calibration(options.calibration),
        options.calibration,
        profile,
        now=utc_now(),
        allow_expired=options.allow_expired,
    )


def _details(plan: Plan, options: BenchOptions) -> dict[str, Any]:
    return {
        "plan": plan.to_dict(),
        "simulation": {"plant": options.plant, "seed": options.seed},
        "bench": {"address": options.address, "realtime": options.realtime},
    }


def _keep_plan(folder: RunFolder, plan: Plan) -> None:
    """Write what a resumed run needs to go on with: the points of a calibration, a plan file."""
    if plan.points:
        write_points(folder.path, plan.points, plan.preset or "report")
    elif plan.motion is not None:
        write_plan(folder.path / PLAN_NAME, plan.motion)
