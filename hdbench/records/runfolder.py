"""The folder of one run: what was done, with what, how it ended, and every file's hash."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from hdbench.errors import StorageError
from hdbench.records.jsonfile import ProfileIdentity, write_json
from hdbench.records.manifest import (
    STATUSES,
    first_manifest,
    make_folder,
    random_token,
    read_manifest,
    this_process,
    utc_now,
    utc_text,
)
from hdbench.records.process import still_running
from hdbench.records.storage import sha256_file

__all__ = ["RunFolder"]

_KIND = re.compile(r"[a-z][a-z0-9-]{0,31}")
_NAMES = ("journal.hdj", "trace.csv", "loads.csv", "result.json", "report.html")


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

    __slots__ = ("_clock", "manifest", "path")

    def __init__(
        self, path: Path, manifest: dict[str, Any], clock: Callable[[], datetime] = utc_now
    ) -> None:
        self.path = path
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
        token: Callable[[], str] = random_token,
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
        path = make_folder(Path(parent), kind, moment, token)
        folder = cls(path, first_manifest(path, kind, profile, details, moment), clock)
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
    def open(cls, path: Path, *, clock: Callable[[], datetime] = utc_now) -> RunFolder:
        """Open a stored run.

        Parameters
        ----------
        path : Path
            Its folder.
        clock : callable
            Time in UTC.

        Returns
        -------
        RunFolder

        Raises
        ------
        DataError
            If it is not a run folder or its ``run.json`` is damaged.
        """
        path = Path(path)
        return cls(path, read_manifest(path), clock)

    @property
    def run_id(self) -> str:
        """Name of the folder."""
        return self.path.name

    @property
    def journal(self) -> Path:
        """Path of the journal."""
        return self.path / "journal.hdj"

    @property
    def trace(self) -> Path:
        """Path of the trace."""
        return self.path / "trace.csv"

    @property
    def loads(self) -> Path:
        """Path of the loads."""
        return self.path / "loads.csv"

    @property
    def result(self) -> Path:
        """Path of the result."""
        return self.path / "result.json"

    @property
    def report(self) -> Path:
        """Path of the report."""
        return self.path / "report.html"

    def status(self) -> str:
        """Return the status; a run whose process is gone is ``incomplete``, not ``running``."""
        status = str(self.manifest["status"])
        if status == "running" and not still_running(self.manifest, self._journal_age_s()):
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
            **this_process(),
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
