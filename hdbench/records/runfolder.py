"""Folder of one run: what was done, with what, how it ended, each file's hash, and notes."""

from __future__ import annotations

import json
import os
import platform
import re
import secrets
import socket
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hdbench.errors import DataError, StorageError, UsageError
from hdbench.records.jsonfile import ProfileIdentity, read_json, result_header, write_json
from hdbench.records.storage import disk_errors, file_bytes, sha256_file
from hdbench.system.files import sync_folder
from hdbench.system.processes import process_exists, process_mark

_KIND = re.compile(r"[a-z][a-z0-9-]{0,31}")
_NAMES = ("journal.hdj", "trace.csv", "loads.csv", "result.json", "report.html")
RUN_SCHEMA = "hdbench/run/1"
STATUSES = ("running", "complete", "incomplete", "aborted")
# a run appends to its journal several times a second; waiting for a weight takes minutes
_SILENCE_S = 600.0


def utc_now() -> datetime:
    """Return the time of the wall clock."""
    return datetime.now(UTC)


def moment_of(text: str | None) -> datetime | None:
    """Return a stored moment, UTC where it names no zone; None for any other text."""
    try:
        moment = datetime.fromisoformat(text or "")
    except ValueError:
        return None
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def _random_token() -> str:
    """Return six random hexadecimal digits."""
    return secrets.token_hex(3)


def utc_text(moment: datetime) -> str:
    """Return a moment as ISO 8601 text in UTC with microseconds."""
    return moment.astimezone(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


def _make_folder(parent: Path, kind: str, moment: datetime, token: Callable[[], str]) -> Path:
    """Make the folder of a new run."""
    stamp = moment.astimezone(UTC).strftime("%Y%m%dT%H%M%SZ")
    with disk_errors(parent):
        parent.mkdir(parents=True, exist_ok=True)
        # two runs in one second meet with probability 6e-8; four in a row never do
        for _ in range(4):
            path = parent / f"{stamp}-{kind}-{token()}"
            try:
                path.mkdir()
            except FileExistsError:
                continue
            sync_folder(parent)
            return path
    raise StorageError("no free run id", where=str(parent), fix="start the run again")


def _this_process() -> dict[str, Any]:
    """Return what tells this process from every other one."""
    pid = os.getpid()
    return {"pid": pid, "process_mark": process_mark(pid), "host": socket.gethostname()}


def _first_manifest(
    path: Path, kind: str, profile: ProfileIdentity, details: Mapping[str, Any], moment: datetime
) -> dict[str, Any]:
    """Return the content of ``run.json`` at the start of a run (contract section 5)."""
    import numpy as np

    head = result_header("run", profile)
    return {
        **head,
        "run_id": path.name,
        "kind": kind,
        "status": "running",
        "started_utc": utc_text(moment),
        "ended_utc": None,
        "exit_reason": None,
        "profile": {**head["profile"], "text": profile.text},
        "drive": profile.drive,
        "sensor": profile.sensor,
        "calibration": None,
        "device": None,
        "versions": {
            "hdbench": head["hdbench_version"],
            "python": platform.python_version(),
            "numpy": np.__version__,
            "system": platform.platform(),
        },
        "files": {},
        **_this_process(),
        "details": dict(details),
    }


def read_manifest(path: Path) -> dict[str, Any]:
    """Read and check the ``run.json`` of a run folder."""
    record = path / "run.json"
    if not record.is_file():
        raise DataError(
            "no run.json; needed: a run folder",
            where=str(path),
            fix="'hdbench runs list' names the stored runs",
        )
    manifest = read_json(record, RUN_SCHEMA)
    needed = {"kind": str, "status": str, "files": dict, "profile": dict}
    wrong = [
        f"key {key!r} is missing or not a {kind.__name__}"
        for key, kind in needed.items()
        if not isinstance(manifest.get(key), kind)
    ]
    if not wrong and manifest["status"] not in STATUSES:
        wrong.append(f"status {manifest['status']!r:.40}; needed: {', '.join(STATUSES)}")
    if wrong:
        raise DataError(wrong[0], where=str(record), fix="restore the file from a copy")
    return manifest


def _still_running(manifest: Mapping[str, Any], journal_age_s: float | None) -> bool:
    """Return whether the process that wrote `manifest` still lives."""
    pid = manifest.get("pid")
    if not (isinstance(pid, int) and 0 < pid < 1 << 31):
        return False
    if manifest.get("host") != socket.gethostname():
        return journal_age_s is not None and journal_age_s < _SILENCE_S
    mark = manifest.get("process_mark")
    if isinstance(mark, str):
        return process_mark(pid) == mark
    return process_exists(pid)


class RunFolder:
    """One run on disk.

    Use `RunFolder.create` for a new run and `RunFolder.open` for a stored one.

    Parameters
    ----------
    path : Path
        The folder.
    manifest : dict
        Content of its ``run.json``.
    clock : callable
        Returns the time in UTC.
    """

    __slots__ = ("_clock", "journal", "loads", "manifest", "path", "report", "result", "trace")

    def __init__(
        self, path: Path, manifest: dict[str, Any], clock: Callable[[], datetime] = utc_now
    ) -> None:
        self.path = path
        self.journal, self.trace, self.loads, self.result, self.report = map(path.joinpath, _NAMES)
        self.manifest = manifest
        self._clock = clock

    @classmethod
    def create(
        cls,
        parent: Path,
        *,
        kind: str,
        profile: ProfileIdentity,
        details: Mapping[str, Any],
        clock: Callable[[], datetime] = utc_now,
        token: Callable[[], str] = _random_token,
    ) -> RunFolder:
        """Make the folder of a new run, with status ``running``.

        Parameters
        ----------
        parent : Path
            Folder of run folders; made if missing.
        kind : str
            Word of the run id, such as ``ripple``: small letters, digits, hyphens.
        profile : Profile
            The bench.
        details : mapping
            Plan, seed, plant and whatever else the run is to remember.
        clock, token : callable
            Time in UTC and random part of the run id.

        Returns
        -------
        RunFolder

        Raises
        ------
        StorageError
            If the folder or its ``run.json`` cannot be written.
        ValueError
            If `kind` is not such a word.
        """
        if not _KIND.fullmatch(kind):
            raise ValueError(f"kind {kind!r} must be small letters, digits and hyphens")
        moment = clock()
        path = _make_folder(Path(parent), kind, moment, token)
        folder = cls(path, _first_manifest(path, kind, profile, details, moment), clock)
        try:
            folder.update()
        except StorageError:
            # nothing is in it yet: no run is left behind that says it goes on
            with suppress(OSError):
                (path / "run.json").unlink(missing_ok=True)
                path.rmdir()
            raise
        return folder

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """Open a stored run.

        Parameters
        ----------
        path : Path
            Its folder.

        Returns
        -------
        RunFolder

        Raises
        ------
        DataError
            If it is not a run folder or its ``run.json`` is damaged.
        """
        path = Path(path)
        return cls(path, read_manifest(path))

    @property
    def run_id(self) -> str:
        """Name of the folder."""
        return self.path.name

    def status(self) -> str:
        """Return the status; a run whose process is gone is ``incomplete``, not ``running``."""
        status = str(self.manifest["status"])
        if status == "running" and not _still_running(self.manifest, self._journal_age_s()):
            return "incomplete"
        return status

    @property
    def is_killed(self) -> bool:
        """Whether the process of the run is gone without having ended it."""
        return str(self.manifest["status"]) == "running" and self.status() != "running"

    def _journal_age_s(self) -> float | None:
        try:
            return self._clock().timestamp() - self.journal.stat().st_mtime
        except OSError:
            return None

    def update(self, **fields: Any) -> None:
        """Set keys of ``run.json`` and write it atomically.

        Parameters
        ----------
        **fields
            Keys and their new values: ``calibration``, ``device``, ``details``, ...

        Raises
        ------
        StorageError
            If the disk is full or failed; the old ``run.json`` is then untouched.
        """
        write_json(self.path / "run.json", {**self.manifest, **fields})
        self.manifest.update(fields)

    def reopen(self) -> None:
        """Mark a run that ended early as running again, by this process.

        Raises
        ------
        StorageError
            If ``run.json`` cannot be written.

        Notes
        -----
        ``sessions`` lists when and how each earlier session ended. What was written then is void:
        the journal has it all, and `finish` writes and hashes it anew.
        """
        body = self.manifest
        ended = {key: body.get(key) for key in ("started_utc", "ended_utc", "exit_reason")}
        ended["exit_reason"] = ended["exit_reason"] or "ended without a word: killed, or no power"
        sessions = [*body.get("sessions", [])]
        if sessions:
            ended["started_utc"] = body.get("resumed_utc")
        self.update(
            sessions=[*sessions, ended],
            status="running",
            resumed_utc=utc_text(self._clock()),
            ended_utc=None,
            exit_reason=None,
            files={},
            **_this_process(),
        )

    def finish(
        self, status: str, exit_reason: str, files: Iterable[Path | str] | None = None
    ) -> None:
        """End the run: status, reason, time, and the hash of every file.

        Parameters
        ----------
        status : str
            ``complete``, ``incomplete`` or ``aborted``.
        exit_reason : str
            One line for a person.
        files : iterable of Path or str, optional
            Files in the folder to hash; by default every one of the contract that is there.

        Raises
        ------
        StorageError
            If ``run.json`` cannot be written.
        DataError
            If a named file is missing.
        ValueError
            If `status` is not one of these.
        """
        if status not in STATUSES[1:]:
            raise ValueError(f"status {status!r} must be one of {', '.join(STATUSES[1:])}")
        self.update(
            status=status,
            exit_reason=exit_reason,
            ended_utc=utc_text(self._clock()),
            files=self._hashes(files),
        )

    def add_files(self, files: Iterable[Path | str] | None = None) -> None:
        """Hash files again, as after writing a report into a finished run.

        Parameters
        ----------
        files : iterable of Path or str, optional
            As for `finish`.

        Raises
        ------
        StorageError
            If ``run.json`` cannot be written.
        DataError
            If a named file is missing.
        """
        self.update(files={**self.manifest["files"], **self._hashes(files)})

    def _hashes(self, files: Iterable[Path | str] | None) -> dict[str, str]:
        if files is None:
            files = [name for name in _NAMES if (self.path / name).is_file()]
        names = [Path(file).name for file in files]
        return {name: sha256_file(self.path / name) for name in names}


_NAME = "notes.jsonl"
_LIMIT_BYTES = 1 << 20
_LONGEST = 500


@dataclass(frozen=True, slots=True)
class RunNote:
    """One note."""

    utc: str  # when it was written, ISO 8601
    text: str  # what it says


def add_note(run: Path, text: str, moment: datetime) -> RunNote:
    """Append a note to a run and wait until the disk has it.

    Parameters
    ----------
    run : Path
        The run folder.
    text : str
        One line of at most 500 characters.
    moment : datetime
        Now, with a time zone.

    Returns
    -------
    RunNote

    Raises
    ------
    UsageError
        If the text is empty, longer, or not printable.
    DataError
        If `run` is no run folder.
    StorageError
        If it cannot be written.
    """
    text = text.strip()
    if not (0 < len(text) <= _LONGEST and text.isprintable()):
        raise UsageError(
            f"found a text of {len(text)} characters; needed: one line of 1 to {_LONGEST} "
            "printable characters",
            where="TEXT",
            fix="shorten it, such as 'new gauges' or 're-clamped'",
        )
    read_manifest(run)
    note = RunNote(utc_text(moment), text)
    file = run / _NAME
    with disk_errors(file):
        # a file of its own: run.json belongs to the process that makes the run
        with file.open("ab") as stream:
            stream.write(json.dumps(asdict(note)).encode() + b"\n")
            stream.flush()
            os.fsync(stream.fileno())
        sync_folder(run)
    return note


def read_notes(run: Path) -> tuple[RunNote, ...]:
    """Return the notes of a run, oldest first.

    Parameters
    ----------
    run : Path
        The run folder.

    Returns
    -------
    tuple of RunNote
        Empty where there are none.

    Raises
    ------
    DataError
        If the file of the notes is damaged.
    """
    file = run / _NAME
    if not file.exists():
        return ()
    notes = []
    raw = file_bytes(file, limit=_LIMIT_BYTES, what="file of notes")
    for number, line in enumerate(raw.split(b"\n"), start=1):
        if not line.strip():
            continue
        try:
            body = json.loads(line)
            notes.append(RunNote(str(body["utc"]), str(body["text"])))
        except (ValueError, KeyError, TypeError) as error:
            raise DataError(
                "not a note; needed: one JSON object with utc and text a line",
                where=f"{file}:{number}",
                fix="mend or remove that line",
            ) from error
    return tuple(notes)
