"""Whether runs are what their records say."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.records.journalsummary import JournalSummary, summarize_journal
from hdbench.records.recovery import data_file, recover_run
from hdbench.records.runfolder import RunFolder
from hdbench.records.storage import sha256_file

__all__ = ["VerifyReport", "verify_run", "verify_runs"]


@dataclass(frozen=True, slots=True)
class VerifyReport:
    """What was found when a run folder was read in full.

    Parameters
    ----------
    run_id, status : str
        Which run; ``incomplete`` where its process is gone.
    problems : tuple of str
        Everything that is not as ``run.json`` says.
    samples_in_journal, readings_in_journal : int
        Acknowledged samples and load readings.
    torn_bytes : int
        Bytes of an unfinished last block; they were never acknowledged.
    files_checked : int
        Files whose SHA-256 was compared.
    recoverable : bool
        True where trace or loads are missing, or older than the journal of a killed run, and can
        be made from it.
    """

    run_id: str
    status: str
    problems: tuple[str, ...]
    samples_in_journal: int = 0
    readings_in_journal: int = 0
    torn_bytes: int = 0
    files_checked: int = 0
    recoverable: bool = False

    @property
    def ok(self) -> bool:
        """True when there is no problem."""
        return not self.problems

    def to_dict(self) -> dict[str, Any]:
        """Return the report as ``--json`` prints it."""
        return {
            "ok": self.ok,
            **{f.name: getattr(self, f.name) for f in dataclasses.fields(self)},
            "problems": list(self.problems),
        }


def _file_problems(folder: RunFolder) -> list[str]:
    problems = []
    for name, expected in folder.manifest["files"].items():
        if Path(name).name != name:
            problems.append(f"{name!r} is not the name of a file in the folder")
        elif not (folder.path / name).is_file():
            problems.append(f"{name} is missing")
        elif sha256_file(folder.path / name) != expected:
            problems.append(f"{name} was changed after the run: its SHA-256 differs")
    return problems


def verify_run(path: Path) -> VerifyReport:
    """Read a run in full and compare it with what its ``run.json`` says.

    Parameters
    ----------
    path : Path
        The run folder.

    Returns
    -------
    VerifyReport

    Raises
    ------
    DataError
        If it is not a run folder or its ``run.json`` is damaged.
    """
    folder = RunFolder.open(path)
    status = folder.status()
    problems = _file_problems(folder)
    content = JournalSummary()
    if folder.journal.exists():
        try:
            content = summarize_journal(folder.journal)
        except DataError as error:
            problems.append(f"journal.hdj: {error.what}")
    if content.problem:
        problems.append(f"journal.hdj: {content.problem}")
    target, block_kind = data_file(folder)
    return VerifyReport(
        run_id=folder.run_id,
        status=status,
        problems=tuple(problems),
        samples_in_journal=content.samples,
        readings_in_journal=content.readings,
        torn_bytes=content.torn_bytes,
        files_checked=len(folder.manifest["files"]),
        recoverable=status != "running"
        and (folder.is_killed or not target.exists())
        and content.count(block_kind) > 0,
    )


def verify_runs(paths: Sequence[Path], *, recover: bool = False) -> list[VerifyReport]:
    """Verify several runs; a folder that is no run is a problem of its own, not the end.

    Parameters
    ----------
    paths : sequence of Path
        Run folders.
    recover : bool
        Write trace or loads of killed runs from their journals first.

    Returns
    -------
    list of VerifyReport

    Raises
    ------
    StorageError
        If a file has to be recovered and cannot be written.
    """
    reports = []
    for path in map(Path, paths):
        try:
            report = verify_run(path)
            if recover and report.recoverable:
                recover_run(RunFolder.open(path))
                report = verify_run(path)
        except DataError as error:
            report = VerifyReport(path.name, "invalid", (f"{error.where}: {error.what}",))
        reports.append(report)
    return reports
