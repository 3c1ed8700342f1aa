"""Room on the disk: asked for before a run, and kept back for its closing."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from pathlib import Path

from hdbench.errors import StorageError
from hdbench.records.storage import storage_error
from hdbench.system.files import allocate

__all__ = ["RESERVE_NAME", "check_space", "free_reserve", "keep_reserve"]

RESERVE_NAME = ".reserve"
# run.json with the profile's text, an event of the journal and the directory's own blocks
_RESERVE = 4 << 20
_MIB = float(1 << 20)


def check_space(folder: Path, needed: int) -> None:
    """Refuse to begin what the disk cannot hold twice over."""
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise storage_error(error, folder) from error
    wanted = 2 * needed + _RESERVE
    if free < wanted:
        raise StorageError(
            f"{free / _MIB:.0f} MiB free; needed: {wanted / _MIB:.0f} MiB, "
            "twice what the run takes",
            where=str(folder),
            fix="free space, or choose another folder with --out; nothing has moved",
        )


def keep_reserve(folder: Path) -> None:
    """Keep 4 MiB back in `folder`, so that a run can be closed on a disk that fills up."""
    path = folder / RESERVE_NAME
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT, 0o644)
        try:
            allocate(handle, _RESERVE)
        finally:
            os.close(handle)
    except OSError as error:
        raise storage_error(error, path) from error


def free_reserve(folder: Path) -> None:
    """Give the reserve back; never raises."""
    # without it there is a little less room for closing the run
    with suppress(OSError):
        (folder / RESERVE_NAME).unlink(missing_ok=True)
