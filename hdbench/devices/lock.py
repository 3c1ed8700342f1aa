"""One process per bench: an advisory lock that dies with its process."""

from __future__ import annotations

import errno
import os
import re
import signal
import socket
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from hdbench.errors import BusyError, StorageError

__all__ = ["exclusive", "holder", "is_line", "release"]

# a run ends within 4 s of SIGTERM, its motor stopped
_RELEASE_S = 6.0
_POLL_S = 0.05
# folders of the system, one per user
_SYSTEM = "/run/user"
_LINES = ("rtu", "ascii", "serial")
_PORT = "502"


@contextmanager
def exclusive(address: str) -> Iterator[None]:
    """Hold the bench at `address` against other processes of this machine.

    Parameters
    ----------
    address : str
        Address of the bench, its host as a number. A serial port is one bench by all its names.

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
    ``flock`` on a file in a folder of this user, and on Linux a name that all users share: both end
    with the process, so that no stale lock can remain. The file tells number and start time of the
    process. Where the system has no ``flock``, the node's own session is the only guard.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    path = _path(address)
    with ExitStack() as held:
        try:
            flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
            descriptor = os.open(path, flags, 0o600)
            held.callback(os.close, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if sys.platform == "linux":
                shared = held.enter_context(socket.socket(socket.AF_UNIX))
                shared.bind(_shared_name(address))
            os.truncate(descriptor, 0)
            os.write(descriptor, f"{os.getpid()} {_start_of(os.getpid())}\n".encode())
        except BlockingIOError as error:
            raise _busy(
                address, f"process {_told(path)[0] or 'unknown'} holds the bench"
            ) from error
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise _busy(address, "a process of another user holds the bench") from error
            raise _unusable(path, error.strerror or str(error)) from error
        yield


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
        If it does not end, or who it is cannot be proven.

    Notes
    -----
    A serial line has one master. Who wants to stop the motor asks the run that has the line, with
    SIGTERM, upon which it makes the bench safe; then the line is free. Signalled is only a process
    of this user that holds the lock at this moment and is as old as the lock says: no stranger
    with a reused number.
    """
    path = _held(address)
    if path is None:
        return
    pid, started = _told(path)
    if pid == os.getpid():
        return
    if not _terminate(pid, started):
        raise _busy(
            address, "a process that cannot be told for certain holds the line", "stop it there"
        )
    until_s = time.monotonic() + timeout_s
    while _held(address) is not None:
        if not time.monotonic() < until_s:
            raise _busy(
                address,
                f"process {pid} holds the line and does not end within {timeout_s:g} s",
                "press the emergency stop, then kill it",
            )
        time.sleep(_POLL_S)


def holder(address: str) -> int | None:
    """Return the number of the process that holds `address`, None when nobody is known to.

    Parameters
    ----------
    address : str
        Address of the bench.

    Returns
    -------
    int or None
    """
    path = _held(address)
    pid, started = (0, "") if path is None else _told(path)
    return pid if pid and started == _start_of(pid) else None


def is_line(address: str) -> bool:
    """Return whether an address is a serial line, which has one master."""
    return address.partition("://")[0] in _LINES


def _terminate(pid: int, started: str) -> bool:
    """Send SIGTERM to the process that began at `started`; return whether it is that one.

    The process is held by a descriptor first: its number cannot go to another one meanwhile.
    """
    if sys.platform != "linux":
        return False
    try:
        process = os.pidfd_open(pid)
    except (OSError, ValueError):
        return False
    try:
        if not started or started != _start_of(pid):
            return False
        signal.pidfd_send_signal(process, signal.SIGTERM)
        # one that was stopped (SIGSTOP, a debugger) would hear of it only when it goes on
        signal.pidfd_send_signal(process, signal.SIGCONT)
    except OSError:
        return False
    finally:
        os.close(process)
    return True


def _start_of(pid: int) -> str:
    """Return when a process of this user began, in ticks of the system; empty if unknown."""
    try:
        folder = Path(f"/proc/{pid}")
        if folder.stat().st_uid != os.geteuid():
            return ""
        # the name in parentheses may hold anything
        return (folder / "stat").read_text(errors="replace").rpartition(")")[2].split()[19]
    except (OSError, IndexError):
        return ""


def _told(path: Path) -> tuple[int, str]:
    """Return number and start time that a lock file tells; 0 where it tells none."""
    try:
        found = re.fullmatch(r"([0-9]{1,9}) ([0-9]*)\n", path.read_text(errors="replace"))
    except OSError:
        found = None
    return (int(found[1]), found[2]) if found else (0, "")


def _held(address: str) -> Path | None:
    """Return the lock file of `address` if a process has locked it, in any folder of this user."""
    try:
        import fcntl
    except ImportError:
        return None
    for folder in _folders():
        path = folder / _file_name(address)
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
        except OSError:
            continue
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return path
        finally:
            os.close(descriptor)
    return None


def _key(address: str) -> str:
    """Return what is the same for all names of one bench: host and port, or the real device."""
    scheme, mark, rest = address.partition("?")[0].partition("://")
    if is_line(address):
        return os.path.realpath(rest)
    if not mark:
        return scheme
    host, colon, port = rest.rpartition(":")
    return rest if colon and port.isdecimal() and host else f"{rest}:{_PORT}"


def _file_name(address: str) -> str:
    return re.sub(r"[^A-Za-z0-9.-]+", "_", _key(address)) + ".lock"


def _shared_name(address: str) -> str:
    """Return a name of the system's own, in no folder, that only one process can have."""
    return f"\0hdbench:{_key(address)}"


def _folders() -> list[Path]:
    """Return the folders of this user alone that locks may be in, the one for new locks first."""
    places = [os.environ.get("XDG_RUNTIME_DIR", ""), f"{_SYSTEM}/{os.geteuid()}"]
    found = [Path(place) / "hdbench" for place in places if place and _is_own(Path(place))]
    return [folder for folder in (*found, _fallback()) if folder in found or _is_own(folder)]


def _fallback() -> Path:
    return Path(os.environ.get("TMPDIR") or "/tmp") / f"hdbench-{os.geteuid()}"


def _is_own(folder: Path) -> bool:
    try:
        found = folder.lstat()
    except OSError:
        return False
    own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid()
    return own and not stat.S_IMODE(found.st_mode) & 0o077


def _path(address: str) -> Path:
    """Return the lock file of `address`, its folder made if need be."""
    folder = next(iter(_folders()), _fallback())
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise _unusable(folder, error.strerror or str(error)) from error
    if not _is_own(folder):
        raise _unusable(folder, "it is not a folder of this user alone")
    return folder / _file_name(address)


def _unusable(path: Path, why: str) -> StorageError:
    return StorageError(
        f"the bench's lock cannot be used ({why})",
        where=str(path),
        fix="remove it, or set XDG_RUNTIME_DIR to a folder of your own with mode 0700",
    )


def _busy(
    address: str, what: str, fix: str = "wait until it has finished, or stop it"
) -> BusyError:
    return BusyError(what, where=address, fix=fix)
