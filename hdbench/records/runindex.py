"""The list of runs in a folder, with a cache beside them that may be deleted at any time."""

from __future__ import annotations

import json
import os
import sqlite3
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.records.runfolder import RunFolder, moment_of

INDEX_NAME = ".runs-index.sqlite"
# raise it when RunSummary or how it is read changes: an index of another layout is made anew
_LAYOUT = 2
# file systems date changes in steps of up to 2 s (FAT); within one a change may leave no trace
_STEP_NS = 2_000_000_000
_LOCK_S = 2.0
# runs read between two writes of the index: what an interrupted first build keeps
_BATCH = 1000
ACCEPTANCE = {True: "accepted", False: "not-accepted", None: "not-decided"}


@dataclass(frozen=True, slots=True)
class RunSummary:
    """One line of the list of runs.

    Parameters
    ----------
    path : Path
        The folder.
    kind, status, started_utc, profile, drive, sensor : str
        As in ``run.json``; status ``invalid`` where that cannot be read.
    verdict : str
        Of a diagnosis its own; of a calibration ``accepted``, ``not-accepted`` or ``not-decided``;
        else ``ok`` or ``doubtful``. Empty without a result.
    exit_reason : str
        How the run ended.
    files : tuple of str
        Names of its hashed files.
    """

    path: Path
    kind: str = ""
    status: str = "invalid"
    started_utc: str = ""
    profile: str = ""
    drive: str = ""
    sensor: str = ""
    verdict: str = ""
    exit_reason: str = ""
    files: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the summary as ``--json`` prints it."""
        body = asdict(self)
        return {"run_id": self.path.name, **body, "path": str(self.path), "files": list(self.files)}


def read_run(path: Path) -> RunSummary:
    """Return the summary of one run, read from its folder."""
    try:
        folder = RunFolder.open(path)
    except DataError:
        return RunSummary(path, exit_reason="run.json cannot be read")
    body = folder.manifest
    names = {
        key: str(body.get(key) or "") for key in ("started_utc", "drive", "sensor", "exit_reason")
    }
    return RunSummary(
        path,
        kind=body["kind"],
        status=folder.status(),
        profile=str(body["profile"].get("name") or ""),
        verdict=_verdict(body["kind"], folder.result),
        files=tuple(map(str, body["files"])),
        **names,
    )


def _verdict(kind: str, file: Path) -> str:
    try:
        result = json.loads(file.read_bytes())
        if kind == "calibration":
            return ACCEPTANCE[result["accepted"]]
        if kind == "diagnosis":
            return str(result["verdict"])
        return "doubtful" if result.get("doubts") or result.get("flags") else "ok"
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return ""


def list_runs(
    parent: Path, *, clock_ns: Callable[[], int] = time.time_ns
) -> tuple[RunSummary, ...]:
    """Return every run in `parent`, by the names of the folders: oldest first.

    Parameters
    ----------
    parent : Path
        Folder of run folders; a missing one holds no runs.
    clock_ns : callable
        Time since the epoch, ns.

    Returns
    -------
    tuple of RunSummary

    Raises
    ------
    DataError
        If the folder cannot be read.

    Notes
    -----
    The folders are the truth. The index keeps, for every run, the summary and what the file system
    says of ``run.json`` and ``result.json`` (times of change, size, number of the file). A run is
    read again when any of that differs, when its last change is not yet older than the coarsest
    clock of a file system, and while it says ``running``. So a stale, lost or half-written index
    costs time, never truth.
    """
    parent = Path(parent)
    if not parent.exists():
        return ()
    try:
        with os.scandir(parent) as entries:
            names = sorted(entry.name for entry in entries if entry.is_dir())
    except OSError as error:
        raise DataError(
            f"cannot read: {error.strerror}", where=str(parent), fix="name a folder of runs"
        ) from error
    states = {name: state for name in names if (state := _state(f"{parent}/{name}"))}
    file = parent / INDEX_NAME
    known = _load(file) if file.exists() else {}
    found: dict[str, RunSummary] = {}
    fresh: list[tuple[bytes, str, str]] = []
    for name, (stamp, changed_ns) in states.items():
        kept_stamp, run = known.get(name, (None, None))
        if run is not None and kept_stamp == stamp:
            found[name] = run
            continue
        found[name] = run = read_run(parent / name)
        if run.status != "running" and clock_ns() - changed_ns > _STEP_NS:
            _, *body = asdict(run).values()
            fresh.append((os.fsencode(name), stamp, json.dumps(body)))
            if len(fresh) == _BATCH:
                _store(file, fresh)
                fresh = []
    gone = [os.fsencode(name) for name in known.keys() - states.keys()]
    if fresh or gone:
        _store(file, fresh, gone)
    return tuple(found.values())


def _state(run: str) -> tuple[str, int] | None:
    """Return what tells this state of a run from every other, and when it changed last, ns."""
    states = []
    for name in ("run.json", "result.json"):
        with suppress(OSError):
            states.append(os.stat(f"{run}/{name}"))
        if not states:
            return None
    stamp = " ".join(f"{s.st_mtime_ns} {s.st_ctime_ns} {s.st_size} {s.st_ino}" for s in states)
    return stamp, max(max(s.st_mtime_ns, s.st_ctime_ns) for s in states)


def _load(file: Path) -> dict[str, tuple[str, RunSummary]]:
    """Return stamp and summary by the name of the run; nothing where the index is of no use."""
    parent = file.parent
    try:
        with closing(sqlite3.connect(file, timeout=_LOCK_S)) as index:
            if index.execute("PRAGMA user_version").fetchone()[0] != _LAYOUT:
                return {}
            rows = index.execute("SELECT name, stamp, body FROM runs").fetchall()
        bodies = json.loads(f"[{','.join(body for _, _, body in rows)}]")
        names = [os.fsdecode(name) for name, _, _ in rows]
        return {
            name: (stamp, RunSummary(parent / name, *(*fields, tuple(files))))
            for name, (_, stamp, _), (*fields, files) in zip(names, rows, bodies, strict=True)
        }
    except (sqlite3.Error, TypeError, ValueError) as error:
        if getattr(error, "sqlite_errorcode", None) != sqlite3.SQLITE_BUSY:
            with suppress(OSError):
                file.unlink()  # damaged; the next update makes a new one
        return {}


def _store(file: Path, rows: Iterable[tuple[bytes, str, str]], gone: Iterable[bytes] = ()) -> None:
    """Write rows into the index, in one transaction; where that fails the next call reads anew."""
    with (
        suppress(sqlite3.DatabaseError),
        closing(sqlite3.connect(file, timeout=_LOCK_S)) as index,
        index,
    ):
        index.execute("BEGIN IMMEDIATE")
        if index.execute("PRAGMA user_version").fetchone()[0] != _LAYOUT:
            index.execute("DROP TABLE IF EXISTS runs")
            index.execute("CREATE TABLE runs (name BLOB PRIMARY KEY, stamp TEXT, body TEXT)")
            index.execute(f"PRAGMA user_version = {_LAYOUT}")
        index.executemany("DELETE FROM runs WHERE name = ?", ((name,) for name in gone))
        index.executemany("INSERT OR REPLACE INTO runs VALUES (?, ?, ?)", rows)


def select_runs(
    runs: Iterable[RunSummary], wanted: Mapping[str, Iterable[str]], since: datetime | None = None
) -> list[RunSummary]:
    """Return the runs that have one of the wanted values in every field named.

    Parameters
    ----------
    runs : iterable of RunSummary
        Runs to choose from.
    wanted : mapping of str to iterable of str
        Values by the field of `RunSummary`; a field without values lets all pass.
    since : datetime or None
        Earliest start, with a time zone.

    Returns
    -------
    list of RunSummary
        In the order given.
    """
    fields = {name: set(values) for name, values in wanted.items() if values}
    # what has no start that can be read is from the beginning of time
    unknown = datetime.min.replace(tzinfo=UTC)
    return [
        run
        for run in runs
        if all(getattr(run, name) in values for name, values in fields.items())
        and (since is None or (moment_of(run.started_utc) or unknown) >= since)
    ]
