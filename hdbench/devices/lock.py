"""One process per bench: an advisory lock that dies with its process."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hdbench.errors import BusyError, StorageError

__all__ = ["exclusive"]


@contextmanager
def exclusive(address: str) -> Iterator[None]:
    """Hold the bench at `address` against other processes of this machine.

    Parameters
    ----------
    address : str
        Address of the bench.

    Yields
    ------
    None
        While the bench is held.

    Raises
    ------
    BusyError
        If another process holds it; the message names its process number.
    StorageError
        If the lock file cannot be written.

    Notes
    -----
    ``flock`` on a file in the temporary folder: it ends with the process, so that no stale lock can
    remain. Where the system has no ``flock``, the node's own session is the only guard.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    name = re.sub(r"[^A-Za-z0-9.-]+", "_", address)
    path = Path(tempfile.gettempdir()) / f"hdbench-{name}.lock"
    descriptor = _open(path)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            pid = os.read(descriptor, 32).decode("ascii", errors="replace").strip()
            raise BusyError(
                f"process {pid or 'unknown'} holds the bench",
                where=address,
                fix="wait until it has finished, or stop it",
            ) from error
        # a file that another user made can be locked, but not written
        with suppress(OSError):
            os.truncate(descriptor, 0)
            os.write(descriptor, f"{os.getpid()}\n".encode())
        yield
    finally:
        os.close(descriptor)


def _open(path: Path) -> int:
    """Return a descriptor of the lock file, made if need be, never through a link."""
    flags = os.O_NOFOLLOW | os.O_CLOEXEC
    try:
        try:
            return os.open(path, os.O_RDWR | os.O_CREAT | flags, 0o644)
        except PermissionError:
            return os.open(path, os.O_RDONLY | flags)
    except OSError as error:
        raise StorageError(
            f"the bench's lock file cannot be opened ({error.strerror})",
            where=str(path),
            fix="remove it, or set TMPDIR to a folder of your own",
        ) from error
