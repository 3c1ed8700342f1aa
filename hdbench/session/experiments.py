"""Experiments: planned, run, kept, evaluated, and resumed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from hdbench.diagnosis.planning.planfile import read_plan, write_plan
from hdbench.diagnosis.planning.segments import MotionPlan
from hdbench.errors import BusyError, DataError, UsageError
from hdbench.filter import kernel_name
from hdbench.filter.presets import choose_filter
from hdbench.profile import Profile, check_loads, stored_profile
from hdbench.profile.scaling import checked_age, profile_scale, read_calibration, stored_scale
from hdbench.records import TorqueScale
from hdbench.records.journal import JournalContent, JournalWriter
from hdbench.records.runfolder import RunFolder, utc_now, utc_text
from hdbench.records.storage import keep_reserve
from hdbench.session import plans
from hdbench.session.calibrating.plan import (
    Preset,
    calibration_plan,
    read_points,
    sequence_plan,
    write_points,
)
from hdbench.session.options import BenchOptions, Progress, RunOutcome, Task
from hdbench.session.run import Run, kept
from hdbench.session.stop import listen


def make_plan(
    kind: str,
    profile: Profile,
    motion: MotionPlan | None = None,
    *,
    preset: Preset | None = None,
) -> plans.Plan:
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
    ProfileError
        If the weights of a calibration are.
    """
    data = profile.data
    if kind == "calibration":
        check_loads(profile)
        plan = calibration_plan(data, preset)
    elif motion is not None:
        plan = plans.motion_plan(kind, motion, data)
    else:
        plan = plans.misalignment_plan(data) if kind == "misalignment" else plans.ripple_plan(data)
    plans.check_plan(plan, data)
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
        details = {
            "plan": plan.to_dict(),
            "simulation": {"plant": options.plant, "seed": options.seed},
            "bench": {"address": options.address, "realtime": options.realtime},
        }
        folder = RunFolder.create(options.out, kind=kind, profile=profile, details=details)
        with kept(folder):
            keep_reserve(folder.path)
            versions = {**folder.manifest["versions"], "kernel": kernel_name()}
            folder.update(calibration=scale.to_dict(), filter=model.to_dict(), versions=versions)
            # what a resumed run needs to go on with
            if plan.points:
                write_points(folder.path, plan.points, plan.preset or "report")
            elif plan.motion is not None:
                write_plan(folder.path / plans.PLAN_NAME, plan.motion)
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


def profile_of(folder: RunFolder) -> Profile:
    """Return the profile that a run was made with; `DataError` where it holds none."""
    profile = stored_profile(folder.manifest, folder.path)
    if profile is None:
        raise DataError(
            "run.json holds no profile",
            where=str(folder.path),
            fix="start the experiment anew; what was recorded is kept in this run",
        )
    return profile


def stored_address(folder: RunFolder) -> str | None:
    """Return the address of the bench controller that a run was asked for."""
    address = stored_table(folder.manifest, "bench").get("address")
    return address if isinstance(address, str) else None


def stored_table(manifest: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a table of the details that a run remembers."""
    details = manifest.get("details")
    found = details.get(name) if isinstance(details, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def resume_run(path: Path, options: BenchOptions, progress: Progress) -> RunOutcome:
    """Go on with a run that was stopped, killed, or lost its bench.

    A calibration goes on at the first point without a reading that counts. A run with motion keeps
    the acquisitions that came to their end; one that was broken off is acquired again from
    standstill, because speed, angle and load of the moment it broke off do not come back, and its
    samples are kept beside the others, marked.
    """
    folder = _resumable(path)
    profile = profile_of(folder)
    plan = _stored_plan(folder, profile)
    scale = stored_scale(folder.manifest.get("calibration"), folder.path) or profile_scale(profile)
    model = choose_filter(profile, None, source=folder.path)
    asked = _as_before(folder, replace(options, motion=plan.motion))
    with listen() as stop:
        if folder.journal.exists():
            journal, content = JournalWriter.resume(folder.journal)
        else:
            journal, content = JournalWriter(folder.journal), JournalContent((), 0, None)
        try:
            # another process may have gone on with the run since it was opened
            folder = _resumable(path)
            folder.reopen()
            noted = {
                "event": "resumed",
                "session": len(folder.manifest["sessions"]) + 1,
                "utc": utc_text(utc_now()),
                "cut_bytes": content.torn_bytes,
                "damage": content.problem,
            }
            journal.append("event", {}, noted)
        except BaseException:
            journal.close()
            raise
        task = Task(plan.kind, profile, asked, plan, scale, model, folder, stop, progress, content)
        with kept(folder):
            run = Run(task, journal)
            run.measure()
            return run.evaluate()


def _resumable(path: Path) -> RunFolder:
    folder = RunFolder.open(path)
    status = folder.status()
    if status == "running":
        raise BusyError(
            f"the run still goes on (process {folder.manifest.get('pid')})",
            where=str(folder.path),
            fix="wait for it to end, or stop it",
        )
    if status != "incomplete":
        raise UsageError(
            f"the run is {status}: {folder.manifest.get('exit_reason')}",
            where=str(folder.path),
            fix="start a new run; only incomplete runs can be resumed",
        )
    return folder


def _stored_plan(folder: RunFolder, profile: Profile) -> plans.Plan:
    kind = str(folder.manifest["kind"])
    if kind == "calibration":
        plan = sequence_plan(read_points(folder.path), profile.data)
        plans.check_plan(plan, profile.data)
        return plan
    if kind not in ("misalignment", "ripple"):
        raise UsageError(
            f"a {kind} run measures nothing",
            where=str(folder.path),
            fix="only calibration, misalignment and ripple runs can be resumed",
        )
    file = folder.path / plans.PLAN_NAME
    return make_plan(kind, profile, read_plan(file) if file.is_file() else None)


def _as_before(folder: RunFolder, options: BenchOptions) -> BenchOptions:
    """Return options with the bench that a run was asked for."""
    bench = stored_table(folder.manifest, "bench")
    simulation = stored_table(folder.manifest, "simulation")
    return replace(
        options,
        out=folder.path.parent,
        plant=str(simulation.get("plant", "as-modelled")),
        seed=int(simulation.get("seed", 0)),
        address=options.address or stored_address(folder),
        realtime=bool(bench.get("realtime")) if options.realtime is None else options.realtime,
    )
