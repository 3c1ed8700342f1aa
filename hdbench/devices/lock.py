"""One process per bench: an advisory lock that dies with its process."""

from __future__ import annotations

import os
import re
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hdbench.errors import BusyError, StorageError

__all__ = ["exclusive", "holder", "release"]

# a run ends within 4 s of SIGTERM, its motor stopped
_RELEASE_S = 6.0
_POLL_S = 0.05


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
    descriptor = _open(_path(address))
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


def release(address: str, *, timeout_s: float = _RELEASE_S) -> None:
    """End the run that holds `address`, if one does, so that its line can be used.

    Parameters
    ----------
    address : str
        Address of the bench.
    timeout_s : float
        Longest wait for the run to make its bench safe and end, s.

    Raises
    ------
    BusyError
        If it does not end, or belongs to another user.

    Notes
    -----
    A serial line has one master. Who wants to stop the motor asks the run that has the line, with
    SIGTERM, upon which it makes the bench safe; then the line is free. The process is the one that
    holds the lock at this moment, so that no stranger with a reused number is ever signalled.
    """
    pid = holder(address)
    if pid is None or pid == os.getpid():
        return
    try:
        os.kill(pid, signal.SIGTERM)
        # one that was stopped (SIGSTOP, a debugger) would hear of it only when it goes on
        os.kill(pid, signal.SIGCONT)
    except OSError as error:
        raise BusyError(
            f"process {pid} holds the line and cannot be stopped ({error.strerror})",
            where=address,
            fix="stop it, or press the emergency stop",
        ) from error
    until_s = time.monotonic() + timeout_s
    while holder(address) is not None:
        if not time.monotonic() < until_s:
            raise BusyError(
                f"process {pid} holds the line and does not end within {timeout_s:g} s",
                where=address,
                fix="press the emergency stop, then kill it",
            )
        time.sleep(_POLL_S)


def holder(address: str) -> int | None:
    """Return the number of the process that holds `address`, None when nobody does.

    Parameters
    ----------
    address : str
        Address of the bench.

    Returns
    -------
    int or None
    """
    try:
        import fcntl
    except ImportError:
        return None
    if not _path(address).exists():
        return None
    descriptor = _open(_path(address))
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        text = os.read(descriptor, 32).decode("ascii", errors="replace").strip()
        return int(text) if text.isdecimal() and int(text) > 1 else None
    finally:
        os.close(descriptor)
    return None


def _path(address: str) -> Path:
    name = re.sub(r"[^A-Za-z0-9.-]+", "_", address)
    return Path(tempfile.gettempdir()) / f"hdbench-{name}.lock"


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
