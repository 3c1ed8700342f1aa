"""Stored runs: the data of a killed one from its journal, and checks of what is on the disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hdbench.errors import DataError, nothing_stored
from hdbench.records import counted
from hdbench.records.journal import read_journal
from hdbench.records.loads import write_loads
from hdbench.records.runfolder import RunFolder
from hdbench.records.storage import free_reserve, sha256_file


def _record(folder: RunFolder) -> Path:
    """Return the file that the journal of a run becomes."""
    return folder.loads if str(folder.manifest["kind"]).startswith("calib") else folder.trace


def recover_run(folder: RunFolder) -> Path:
    """Write trace or loads of a killed run from its journal, and mark it ``incomplete``."""
    if folder.status() == "running":
        raise DataError(
            f"the run still goes on (process {folder.manifest.get('pid')})",
            where=str(folder.path),
            fix="wait for it to end",
        )
    problem = counted.summarize_journal(folder.journal).problem
    target = _record(folder)
    if target == folder.loads:
        content = read_journal(folder.journal)
        write_loads(target, counted.journal_loads(content, str(folder.journal)))
        counted.write_sequence(folder.path, content)
    else:
        counted.survey_samples(folder.journal).write(target)
    free_reserve(folder.path)
    if folder.manifest["status"] == "running":
        damage = f"; {problem}" if problem else ""
        folder.finish("incomplete", f"killed; recovered from its journal{damage}")
    else:
        folder.add_files([target])
    return target


def resolve_input(path: Path) -> Path:
    """Return the trace or loads file that `path` stands for.

    Parameters
    ----------
    path : Path
        A file, which stands for itself, or a run folder: its ``trace.csv`` or ``loads.csv``. A
        killed run gets its file from its journal first.

    Returns
    -------
    Path

    Raises
    ------
    DataError
        If nothing is there, or the folder is not a run with data.
    StorageError
        If a file has to be recovered and cannot be written.
    """
    path = Path(path)
    if path.is_file():
        return path
    if not path.is_dir():
        raise nothing_stored(path)
    folder = RunFolder.open(path)
    if folder.is_killed and folder.journal.exists():
        return recover_run(folder)
    for candidate in (_record(folder), folder.trace, folder.loads):
        if candidate.is_file():
            return candidate
    if not folder.journal.exists():
        raise DataError(
            f"this {folder.manifest['kind']} run holds no trace.csv, loads.csv or journal.hdj",
            where=str(path),
            fix="name a run of an experiment",
        )
    return recover_run(folder)


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
        return {"ok": self.ok, **asdict(self), "problems": list(self.problems)}


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
    """Read a run in full and compare it with what its ``run.json`` says."""
    folder = RunFolder.open(path)
    status = folder.status()
    problems = _file_problems(folder)
    content = counted.JournalSummary()
    if folder.journal.exists():
        try:
            content = counted.summarize_journal(folder.journal)
        except DataError as error:
            problems.append(f"journal.hdj: {error.what}")
    if content.problem:
        problems.append(f"journal.hdj: {content.problem}")
    target = _record(folder)
    acknowledged = content.readings if target == folder.loads else content.samples
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
        and acknowledged > 0,
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
