"""Keyboard: single keys from a terminal, or lines from a pipe."""

from __future__ import annotations

import os
import queue
import select
import signal
import threading
import time
from contextlib import suppress
from typing import Any, Protocol

_CHUNK = 64
# how often the console of Windows is looked at, s
_LOOK_S = 0.02
_CTRL_C = "\x03"
# before the code of an arrow or function key
_SPECIAL = ("\x00", "\xe0")


class Keyboard(Protocol):
    """Reads standard input, or another file, without a wait where nothing has come."""

    def take_single(self) -> bool:
        """Let a terminal hand each key over at once, without echo; return whether it does."""

    def give_back(self) -> None:
        """Set the terminal as it was. Never raises."""

    def ready(self, seconds: float) -> bool:
        """Return whether `read` has something, or the end, within this time."""

    def read(self) -> bytes:
        """Wait for what comes next, and return it; nothing at the end."""


def keyboard(descriptor: int) -> Keyboard:
    """Return what reads a file in the way of this system."""
    try:
        import termios  # noqa: F401 - asked for, not used
    except ImportError:
        return _console(descriptor) or _Lines(descriptor)
    return _Terminal(descriptor)


class _Terminal:
    """In the manner of POSIX."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._before: Any = None

    def take_single(self) -> bool:
        import termios
        import tty

        try:
            before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor, termios.TCSANOW)
        except termios.error:
            return False
        if self._before is None:
            self._before = before
        return True

    def give_back(self) -> None:
        import termios

        before, self._before = self._before, None
        if before is not None:
            # a terminal that is gone cannot be set back
            with suppress(termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, before)

    def ready(self, seconds: float) -> bool:
        try:
            return bool(select.select([self._descriptor], [], [], seconds)[0])
        except (OSError, ValueError):
            return True

    def read(self) -> bytes:
        return _read(self._descriptor)


class _Lines:
    """Reads in a thread: where a pipe cannot be waited for."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._pieces: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._next: bytes | None = None
        self._thread: threading.Thread | None = None

    def take_single(self) -> bool:
        return False

    def give_back(self) -> None:
        pass

    def ready(self, seconds: float) -> bool:
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="input", daemon=True)
            self._thread.start()
        if self._next is None:
            with suppress(queue.Empty):
                self._next = self._pieces.get(timeout=max(seconds, 1e-3))
        return self._next is not None

    def read(self) -> bytes:
        # in short waits: on Windows Ctrl-C does not end a long one
        while not self.ready(_LOOK_S):
            pass
        piece, self._next = self._next or b"", None
        return piece

    def _run(self) -> None:
        while True:
            piece = _read(self._descriptor)
            self._pieces.put(piece)
            if not piece:
                return


class _Console:
    """The console of Windows."""

    def __init__(self, msvcrt: Any) -> None:
        self._msvcrt = msvcrt

    def take_single(self) -> bool:
        return True

    def give_back(self) -> None:
        pass

    def ready(self, seconds: float) -> bool:
        until_s = time.monotonic() + seconds
        while not self._msvcrt.kbhit():
            if not time.monotonic() < until_s:
                return False
            time.sleep(_LOOK_S)
        return True

    def read(self) -> bytes:
        while not self.ready(_LOOK_S):
            pass
        key: str = self._msvcrt.getwch()
        if key == _CTRL_C:
            signal.raise_signal(signal.SIGINT)
        if key in _SPECIAL:
            # an escape stands for a key that is no character
            self._msvcrt.getwch()
            return b"\x1b"
        return key.encode(errors="replace")


def _console(descriptor: int) -> _Console | None:
    try:
        import msvcrt
    except ImportError:
        return None
    return _Console(msvcrt) if os.isatty(descriptor) else None


def _read(descriptor: int) -> bytes:
    try:
        return os.read(descriptor, _CHUNK)
    except OSError:  # the terminal has gone
        return b""
