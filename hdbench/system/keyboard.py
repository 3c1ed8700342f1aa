"""Keyboard: single keys from a terminal, or lines from a pipe."""

from __future__ import annotations

import os
import queue
import select
import signal
import threading
import time
from contextlib import suppress
from typing import Any

_CHUNK = 64
# how often the console of Windows is looked at, s
_LOOK_S = 0.02
_CTRL_C = "\x03"
# before the code of an arrow or function key
_SPECIAL = ("\x00", "\xe0")


def keyboard(descriptor: int) -> Keyboard:
    """Return what reads a file in the way of this system."""
    with suppress(ImportError):
        import termios  # noqa: F401 - asked for, not used

        return _Terminal(descriptor)
    with suppress(ImportError):
        import msvcrt

        if os.isatty(descriptor):
            return _Console(descriptor, msvcrt)
    return Keyboard(descriptor)


class Keyboard:
    """Reads standard input, or another file, in a thread: where it cannot be waited for."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._pieces: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._next: bytes | None = None
        self._thread: threading.Thread | None = None

    def take_single(self) -> bool:
        """Let a terminal hand each key over at once, without echo; return whether it does."""
        return False

    def give_back(self) -> None:
        """Set the terminal as it was. Never raises."""

    def ready(self, seconds: float) -> bool:
        """Return whether `read` has something, or the end, within this time."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="input", daemon=True)
            self._thread.start()
        if self._next is None:
            with suppress(queue.Empty):
                self._next = self._pieces.get(timeout=max(seconds, 1e-3))
        return self._next is not None

    def read(self) -> bytes:
        """Wait for what comes next, and return it; nothing at the end."""
        # in short waits: on Windows Ctrl-C does not end a long one
        while not self.ready(_LOOK_S):
            pass
        piece, self._next = self._next or b"", None
        return piece

    def _run(self) -> None:
        piece = b" "
        while piece:
            piece = self._piece()
            self._pieces.put(piece)

    def _piece(self) -> bytes:
        try:
            return os.read(self._descriptor, _CHUNK)
        except OSError:  # the terminal has gone
            return b""


class _Terminal(Keyboard):
    """In the manner of POSIX."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor)
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
        return self._piece()


class _Console(Keyboard):
    """The console of Windows."""

    def __init__(self, descriptor: int, msvcrt: Any) -> None:
        super().__init__(descriptor)
        self._msvcrt = msvcrt

    def take_single(self) -> bool:
        return True

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
