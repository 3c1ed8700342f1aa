"""`hdbench runs resume`: who answers, what is shown."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdbench_cli.asking.choice import Who, attendance
from hdbench_cli.commands.outcome import Shown, present
from hdbench_cli.next_step import after_run
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from hdbench.profile import Profile
    from hdbench.session import BenchOptions, RunOutcome

__all__ = ["Resume", "resume_command"]

# who shows the result of which kind of run
_SHOWN = {"calibration": "calibrate", "misalignment": "run_misalignment", "ripple": "run_ripple"}


@dataclass(frozen=True, slots=True)
class Resume:
    """What the user asked for."""

    run: Path
    address: str | None = None
    control: str | None = None
    yes: bool = False
    no_input: bool = False
    check: bool = False
    realtime: bool | None = None
    no_report: bool = False
    who: Who = "auto"
    mistakes: str = ""


def resume_command(output: Output, asked: Resume) -> None:
    """Go on with a run and show its result."""
    from hdbench.devices.operator import parse_mistakes
    from hdbench.records import RunFolder
    from hdbench.session import BenchOptions
    from hdbench.session.resuming import stored_address, stored_profile
    from hdbench_cli.asking.operator import ConsoleOperator

    folder = RunFolder.open(asked.run)
    kind = str(folder.manifest["kind"])
    asked = replace(asked, address=asked.address or stored_address(folder))
    profile = stored_profile(folder)
    person = asked.yes or not asked.no_input
    options = BenchOptions(
        out=asked.run.parent,
        address=asked.address,
        control=asked.control,
        realtime=asked.realtime,
        operator=ConsoleOperator(motion_confirmed=asked.yes) if person else None,
        mistakes=parse_mistakes(asked.mistakes),
    )
    outcome = _go_on(output, asked, kind, profile, options)

    def then(folder: Path, result: Mapping[str, Any]) -> str:
        return after_run(kind, folder, result)

    module = importlib.import_module(f"hdbench_cli.commands.{_SHOWN[kind]}")
    found = (outcome.folder.path, outcome.evaluation.result.to_json())
    present(output, asked, profile, found, Shown(module.show, module.failed, then))


def _go_on(
    output: Output, asked: Resume, kind: str, profile: Profile, options: BenchOptions
) -> RunOutcome:
    from hdbench.session.resuming import resume_run
    from hdbench_cli.live.view import live_view

    if kind == "calibration":
        with attendance(output, asked.who, profile, asked) as (talk, rehearse, progress):
            told = replace(options, talk=talk, rehearse=rehearse)
            return resume_run(asked.run, told, progress)
    with live_view(kind, profile, asked.run.parent) as watcher:
        return resume_run(asked.run, replace(options, watcher=watcher), lambda _what, _share: None)
