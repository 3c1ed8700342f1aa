"""Files written whole or not at all, and the room on the disk that a run needs."""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
import shutil
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from hdbench.errors import DataError, StorageError, UsageError
from hdbench.system.files import allocate, sync_file, sync_folder

RESERVE_NAME = ".reserve"
# run.json with the profile's text, an event of the journal and the directory's own blocks
_RESERVE = 4 << 20
_MIB = float(1 << 20)


def storage_error(error: OSError, path: Path) -> StorageError:
    """Return `error` as the error that a person at the bench can act on."""
    fix = "free space or choose another folder with --out; what was acknowledged is kept"
    if error.errno == errno.ENOENT:
        fix = "make that folder first, or choose another one with --out"
    if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
        fix = "choose a folder with --out that you may write to, or ask for the right to this one"
    if error.errno in (errno.EEXIST, errno.ENOTDIR, errno.EISDIR):
        fix = "name another --out: a file stands where a folder has to be, or a folder for a file"
    return StorageError(f"cannot write: {error.strerror or error}", where=str(path), fix=fix)


@contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Raise an error of the system as the one that `storage_error` makes of it."""
    try:
        yield
    except OSError as error:
        raise storage_error(error, path) from error


def _is_special(path: Path) -> bool:
    """Return True for a device or pipe: written into, never replaced by a file."""
    return path.exists() and not (path.is_file() or path.is_dir())


def write_atomic(path: Path, chunks: bytes | Iterable[bytes]) -> None:
    """Write a whole file: temporary file beside it, sync, rename, sync of the folder.

    Parameters
    ----------
    path : Path
        File to write or replace; its folder must exist. A link stays and its target is written; a
        device or pipe is written into.
    chunks : bytes or iterable of bytes
        The content.

    Raises
    ------
    StorageError
        If the disk is full or failed, or the folder is missing; the old file is then untouched.
    """
    path = Path(os.path.realpath(path))
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    chunks = (chunks,) if isinstance(chunks, bytes) else chunks
    with disk_errors(path):
        if _is_special(path):
            with path.open("wb") as special:
                special.writelines(chunks)
            return
        try:
            with temporary.open("xb") as file:
                file.writelines(chunks)
                file.flush()
                sync_file(file.fileno())
            temporary.replace(path)
            sync_folder(path.parent)
        finally:
            temporary.unlink(missing_ok=True)


def staged_path(path: Path) -> Path:
    """Return a hidden name beside `path`, with the same endings, for unchecked content."""
    return path.with_name(f".staged-{secrets.token_hex(4)}-{path.name}")


def publish(staged: Path, path: Path) -> None:
    """Give checked content its name."""
    with disk_errors(path):
        if _is_special(path):
            path.write_bytes(staged.read_bytes())
            staged.unlink()
            return
        staged.replace(path)
        sync_folder(path.parent)


def write_new(path: Path, content: bytes) -> None:
    """Write a file that must not be there yet.

    Parameters
    ----------
    path : Path
        File to make.
    content : bytes
        Its content.

    Raises
    ------
    UsageError
        If the file exists.
    StorageError
        If the disk is full or failed.
    """
    if path.exists():
        raise UsageError("the file exists", where=str(path), fix="name a new file")
    write_atomic(path, content)


@contextmanager
def read_errors(path: Path) -> Iterator[None]:
    """Raise whatever keeps a file from being read as one error of ours."""
    try:
        yield
    except (OSError, EOFError, ValueError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        what = f"cannot read: {reason}"
        raise DataError(what, where=str(path), fix="check path and rights") from error


def checked_size(path: Path, *, limit: int, what: str, missing: str = "check the path") -> int:
    """Return the size of a regular file of at most `limit` bytes; `missing` is a fix."""
    with read_errors(path):
        if not path.exists():
            raise DataError(f"no such {what}", where=str(path), fix=missing)
        if not path.is_file():
            raise DataError(
                f"not a regular file; needed: a {what}", where=str(path), fix="name the file itself"
            )
        size = path.stat().st_size
    if size > limit:
        raise DataError(
            f"{size} bytes; needed: a {what} of at most {limit} bytes",
            where=str(path),
            fix="check that this is the right file, or split it",
        )
    return size


def file_bytes(path: Path, **needed: Any) -> bytes:
    """Read a regular file that is as `checked_size` needs it."""
    checked_size(path, **needed)
    with read_errors(path):
        return path.read_bytes()


def sha256_file(path: Path) -> str:
    """Return the SHA-256 of a file as 64 hexadecimal digits."""
    with read_errors(path), Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_space(folder: Path, needed: int) -> None:
    """Refuse to begin what the disk cannot hold twice over."""
    with disk_errors(folder):
        free = shutil.disk_usage(folder).free
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
    with disk_errors(path):
        handle = os.open(path, os.O_WRONLY | os.O_CREAT, 0o644)
        try:
            allocate(handle, _RESERVE)
        finally:
            os.close(handle)


def free_reserve(folder: Path) -> None:
    """Give the reserve back; never raises."""
    # without it there is a little less room for closing the run
    with suppress(OSError):
        (folder / RESERVE_NAME).unlink(missing_ok=True)
