"""Resumed runs: in the same folder, after what the journal holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from hdbench.diagnosis.planning.planfile import read_plan
from hdbench.errors import BusyError, DataError, UsageError
from hdbench.filter import FilterModel
from hdbench.profile import Profile, parse_profile
from hdbench.profile.scaling import profile_scale, stored_scale
from hdbench.records.journal import JournalContent, JournalWriter
from hdbench.records.runfolder import RunFolder, utc_now, utc_text
from hdbench.session.calibrating.plan import sequence_plan
from hdbench.session.calibrating.points import PLAN_NAME, read_points
from hdbench.session.experiments import make_plan
from hdbench.session.filters import choose_filter
from hdbench.session.options import BenchOptions, RunOutcome, Task
from hdbench.session.planning import check_plan
from hdbench.session.plans import Plan
from hdbench.session.run import Run, kept
from hdbench.session.runner import Progress
from hdbench.session.stop import StopSignals, listen


def stored_profile(folder: RunFolder) -> Profile:
    """Return the profile that a run was made with."""
    text = folder.manifest["profile"].get("text")
    if not isinstance(text, str):
        raise DataError(
            "run.json holds no profile",
            where=str(folder.path),
            fix="start the experiment anew; what was recorded is kept in this run",
        )
    return parse_profile(text, f"{folder.path / 'run.json'}: profile")


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
    folder = RunFolder.open(path)
    _check_status(folder)
    profile = stored_profile(folder)
    plan = _stored_plan(folder, profile)
    with listen() as stop:
        journal, content = _open_journal(folder)
        try:
            # another process may have gone on with the run since it was opened
            folder = RunFolder.open(path)
            _check_status(folder)
            folder.reopen()
            _note_session(journal, content, folder)
            task = _task(folder, profile, plan, options, content, stop, progress)
        except BaseException:
            journal.close()
            raise
        with kept(folder):
            run = Run(task, journal)
            run.measure()
            return run.evaluate()


def _check_status(folder: RunFolder) -> None:
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


def _open_journal(folder: RunFolder) -> tuple[JournalWriter, JournalContent]:
    if folder.journal.exists():
        return JournalWriter.resume(folder.journal)
    return JournalWriter(folder.journal), JournalContent((), 0, None)


def _note_session(journal: JournalWriter, content: JournalContent, folder: RunFolder) -> None:
    noted: dict[str, Any] = {
        "event": "resumed",
        "session": len(folder.manifest["sessions"]) + 1,
        "utc": utc_text(utc_now()),
        "cut_bytes": content.torn_bytes,
        "damage": content.problem,
    }
    journal.append("event", {}, noted)


def _stored_plan(folder: RunFolder, profile: Profile) -> Plan:
    kind = str(folder.manifest["kind"])
    if kind == "calibration":
        plan = sequence_plan(read_points(folder.path), profile.data)
        check_plan(plan, profile.data)
        return plan
    if kind not in ("misalignment", "ripple"):
        raise UsageError(
            f"a {kind} run measures nothing",
            where=str(folder.path),
            fix="only calibration, misalignment and ripple runs can be resumed",
        )
    file = folder.path / PLAN_NAME
    return make_plan(kind, profile, read_plan(file) if file.is_file() else None)


def _task(
    folder: RunFolder,
    profile: Profile,
    plan: Plan,
    options: BenchOptions,
    content: JournalContent,
    stop: StopSignals,
    progress: Progress,
) -> Task:
    manifest = folder.manifest
    scale = stored_scale(manifest.get("calibration"), folder.path) or profile_scale(profile)
    ran = manifest.get("filter")
    if isinstance(ran, dict):
        model = FilterModel.from_dict(ran, source=f"{folder.path / 'run.json'}: filter")
    else:
        model = choose_filter(profile, None)
    bench = stored_table(manifest, "bench")
    simulation = stored_table(manifest, "simulation")
    asked = replace(
        options,
        out=folder.path.parent,
        plant=str(simulation.get("plant", "as-modelled")),
        seed=int(simulation.get("seed", 0)),
        address=options.address or stored_address(folder),
        realtime=bool(bench.get("realtime")) if options.realtime is None else options.realtime,
        motion=plan.motion,
    )
    return Task(plan.kind, profile, asked, plan, scale, model, folder, stop, progress, content)
