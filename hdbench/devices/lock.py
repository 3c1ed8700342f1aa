"""Bench lock: one process per bench, and the request to end that process."""

from __future__ import annotations

import errno
import os
import re
import secrets
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hdbench.errors import BusyError, StorageError
from hdbench.system.files import OPEN_OWN, is_own, lock_file, user_folders
from hdbench.system.processes import hold_name, process_mark, signal_self, terminate

_ANSWER_S = 1.0
_GRAIN_S = 0.2
_LONGEST = 64
# a run ends within 4 s of SIGTERM, its motor stopped
_RELEASE_S = 6.0
_POLL_S = 0.05
# from locking the file to writing it takes milliseconds
_WRITING_S = 1.0
_LINES = ("rtu", "ascii", "serial")
_PORT = "502"


@dataclass(frozen=True, slots=True)
class Holder:
    """The process that holds a bench, as its lock file tells; 0 and empty where it tells nothing.

    Parameters
    ----------
    pid : int
        Process number.
    mark : str
        As `hdbench.system.processes.process_mark` gives it; ``-`` where the system tells none.
    port : int
        Where it listens.
    secret : str
        What it is told.
    """

    pid: int = 0
    mark: str = ""
    port: int = 0
    secret: str = ""

    def ask(self, what: Literal["here", "stop"]) -> bool:
        """Ask whether it is there, or to end; return whether it said yes."""
        if not self.port:
            return False
        try:
            with socket.create_connection(("127.0.0.1", self.port), timeout=_ANSWER_S) as link:
                link.sendall(f"{what} {self.secret}\n".encode())
                return link.recv(_LONGEST) == b"yes\n"
        except OSError:
            return False


@contextmanager
def listening() -> Iterator[str]:
    """Take requests until the end of the block."""
    secret = secrets.token_hex(16)
    ended = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(_GRAIN_S)
        threading.Thread(target=_serve, args=(listener, secret, ended), daemon=True).start()
        try:
            yield f"{listener.getsockname()[1]} {secret}"
        finally:
            ended.set()


def _serve(listener: socket.socket, secret: str, ended: threading.Event) -> None:
    while not ended.is_set():
        try:
            link, _ = listener.accept()
        except TimeoutError:
            continue
        except OSError:
            # closed, or no descriptor left for a moment
            ended.wait(_GRAIN_S)
            continue
        # one who says nothing holds up nobody else
        threading.Thread(target=_answer, args=(link, secret, ended), daemon=True).start()


def _answer(link: socket.socket, secret: str, ended: threading.Event) -> None:
    with link, suppress(OSError):
        link.settimeout(_ANSWER_S)
        asked = link.recv(_LONGEST).decode("ascii", "replace").strip()
        what, _, said = asked.partition(" ")
        if secrets.compare_digest(said.encode(), secret.encode()) and what in ("here", "stop"):
            link.sendall(b"yes\n")
            if what == "stop" and not ended.is_set():
                signal_self(signal.SIGTERM)


@contextmanager
def exclusive(address: str) -> Iterator[None]:
    """Hold the bench at `address` against other processes of this machine.

    Notes
    -----
    A lock on a file in a folder of this user, and on Linux a name that all users share: both end
    with the process, so that no stale lock can remain. The file tells number and mark of the
    process, and where it takes a request to stop. On a file system without locks a bench is held
    while that place answers, so that only two runs started at the same moment are not told apart.
    """
    path = _path(address)
    with ExitStack() as held:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | OPEN_OWN, 0o600)
            held.callback(os.close, descriptor)
            locked = lock_file(descriptor)
            if locked is False or (locked is None and _holder_in(path).ask("here")):
                who = _holder_in(path).pid or "unknown"
                raise _busy(address, f"process {who} holds the bench")
            held.enter_context(hold_name(f"hdbench:{_key(address)}"))
            asked = held.enter_context(listening())
            os.ftruncate(descriptor, 0)
            mark = process_mark(os.getpid()) or "-"
            os.write(descriptor, f"{os.getpid()} {mark} {asked}\n".encode())
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise _busy(address, "a process of another user holds the bench") from error
            raise _unusable(path, error.strerror or str(error)) from error
        yield


def release(address: str, *, timeout_s: float = _RELEASE_S) -> None:
    """End the run that holds `address`, if one does, so that its line can be used.

    Notes
    -----
    A serial line has one master. Who wants to stop the motor asks the run that has the line to end
    as upon SIGTERM, upon which it makes the bench safe; then the line is free. Asked is only the
    process that holds the lock: where the system can prove which one that is (Linux), by the signal
    itself, else at the place that the lock file tells, with the secret word that stands there.
    """
    start_s, asked = time.monotonic(), False
    while (path := _held(address)) is not None:
        found = _holder_in(path)
        if found.pid == os.getpid():
            return
        asked = asked or terminate(found.pid, found.mark) or found.ask("stop")
        waited_s = time.monotonic() - start_s
        # whoever has just locked it has yet to write who it is
        if not asked and waited_s >= min(timeout_s, _WRITING_S):
            raise _busy(
                address, "a process that cannot be told for certain holds the line", "stop it there"
            )
        if not waited_s < timeout_s:
            raise _busy(
                address,
                f"process {found.pid} holds the line and does not end within {timeout_s:g} s",
                "press the emergency stop, then kill it",
            )
        time.sleep(_POLL_S)


def is_line(address: str) -> bool:
    """Return whether an address is a serial line, which has one master."""
    return address.partition("://")[0] in _LINES


def _holder_in(path: Path) -> Holder:
    """Return what a lock file tells of its process."""
    form = r"([0-9]{1,9}) (\S+) ([0-9]{1,5}) ([0-9a-f]{32})\n"
    try:
        found = re.fullmatch(form, path.read_text(errors="replace"))
    except OSError:
        found = None
    return Holder(int(found[1]), found[2], int(found[3]), found[4]) if found else Holder()


def _held(address: str) -> Path | None:
    """Return the lock file of `address` if a process has locked it, in any folder of this user."""
    for folder in filter(is_own, user_folders()):
        path = folder / _file_name(address)
        try:
            descriptor = os.open(path, os.O_RDWR | OPEN_OWN)
        except OSError:
            continue
        try:
            locked = lock_file(descriptor)
        finally:
            os.close(descriptor)
        if locked is False or (locked is None and _holder_in(path).ask("here")):
            return path
    return None


def _key(address: str) -> str:
    """Return what is the same for all names of one bench: host and port, or the real device."""
    scheme, mark, rest = address.partition("?")[0].partition("://")
    if is_line(address):
        return os.path.realpath(rest)
    if not mark:
        return scheme
    host, colon, port = rest.rpartition(":")
    if not (colon and port.isdecimal() and host):
        host, port = rest, _PORT
    # every address of this computer leads to the emulator that listens there
    return f"{'localhost' if _is_here(host.strip('[]')) else host}:{port}"


def _is_here(number: str) -> bool:
    """Return whether this is an address of this computer, on which alone a program can listen."""
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(
            number, 0, type=socket.SOCK_STREAM, flags=socket.AI_NUMERICHOST
        )[0]
        with socket.socket(family, kind, protocol) as listener:
            listener.bind(place)
    except OSError:
        return False
    return True


def _file_name(address: str) -> str:
    return re.sub(r"[^A-Za-z0-9.-]+", "_", _key(address)) + ".lock"


def _path(address: str) -> Path:
    """Return the lock file of `address`, its folder made if need be."""
    folder = user_folders()[0]
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise _unusable(folder, error.strerror or str(error)) from error
    if not is_own(folder):
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
