"""What ``run.json`` holds when a run starts, and the name of its folder."""

from __future__ import annotations

import os
import platform
import secrets
import socket
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hdbench.errors import DataError, StorageError
from hdbench.records.jsonfile import ProfileIdentity, read_json, result_header
from hdbench.records.storage import storage_error
from hdbench.system.files import sync_folder
from hdbench.system.processes import process_mark

__all__ = [
    "RUN_SCHEMA",
    "STATUSES",
    "first_manifest",
    "make_folder",
    "random_token",
    "read_manifest",
    "this_process",
    "utc_now",
    "utc_text",
]

RUN_SCHEMA = "hdbench/run/1"
STATUSES = ("running", "complete", "incomplete", "aborted")


def utc_now() -> datetime:
    """Return the time of the wall clock."""
    return datetime.now(UTC)


def random_token() -> str:
    """Return six random hexadecimal digits."""
    return secrets.token_hex(3)


def utc_text(moment: datetime) -> str:
    """Return a moment as ISO 8601 text in UTC with microseconds."""
    return moment.astimezone(UTC).isoformat(timespec="microseconds").replace("+00:00", "Z")


def make_folder(parent: Path, kind: str, moment: datetime, token: Callable[[], str]) -> Path:
    """Make the folder of a new run."""
    stamp = moment.astimezone(UTC).strftime("%Y%m%dT%H%M%SZ")
    try:
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
    except OSError as error:
        raise storage_error(error, parent) from error
    raise StorageError("no free run id", where=str(parent), fix="start the run again")


def this_process() -> dict[str, Any]:
    """Return what tells this process from every other one."""
    pid = os.getpid()
    return {"pid": pid, "process_mark": process_mark(pid), "host": socket.gethostname()}


def first_manifest(
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
        **this_process(),
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
    for key, kind in (("kind", str), ("status", str), ("files", dict), ("profile", dict)):
        if not isinstance(manifest.get(key), kind):
            raise DataError(
                f"key {key!r} is missing or not a {kind.__name__}",
                where=str(record),
                fix="restore the file from a copy",
            )
    if manifest["status"] not in STATUSES:
        raise DataError(
            f"status {manifest['status']!r:.40}; needed: {', '.join(STATUSES)}",
            where=str(record),
            fix="restore the file from a copy",
        )
    return manifest
