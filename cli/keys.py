"""Keys of a person: single ones on a terminal, lines elsewhere."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

__all__ = ["END", "Keys"]

END = ""
"""What `Keys.wait` returns when nobody can answer any more."""

_ESCAPE = "\x1b"
_CHUNK = 64


class Keys:
    """Reads what a person presses.

    Parameters
    ----------
    descriptor : int
        File to read; standard input by default.

    Notes
    -----
    On a terminal a key counts as soon as it is pressed, without echo; Ctrl-C stays a signal.
    Elsewhere a line counts: its words, then Enter.
    """

    def __init__(self, descriptor: int = 0) -> None:
        self._descriptor = descriptor
        self.terminal = os.isatty(descriptor)
        self.single = False
        self._waiting = ""
        self._ended = False

    @contextmanager
    def opened(self) -> Iterator[Keys]:
        """Take single keys from a terminal until the end of the block.

        Yields
        ------
        Keys
            Itself.
        """
        before = self._single_keys() if self.terminal else None
        try:
            yield self
        finally:
            if before is not None:
                import termios

                # a terminal that is gone cannot be set back
                with suppress(termios.error):
                    termios.tcsetattr(self._descriptor, termios.TCSADRAIN, before)
            self.single = False

    def _single_keys(self) -> Any:
        try:
            import termios
            import tty
        except ImportError:
            return None
        try:
            before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor, termios.TCSANOW)
        except termios.error:
            return None
        self.single = True
        return before

    def forget(self) -> None:
        """Drop what was typed ahead on a terminal: an answer belongs to the question before it."""
        if self.single:
            self._single_keys()  # a stop with Ctrl-Z may have changed the terminal
            while self._ready(0.0) and not self._ended:
                self._read()
            self._waiting = ""

    def wait(self) -> str:
        """Wait for a key or a line.

        Returns
        -------
        str
            One character with single keys, a whole line ending in a newline elsewhere; `END` when
            the input has ended.
        """
        while True:
            taken = self._take()
            if taken is not None:
                return taken
            if self._ended:
                return END
            self._read()

    def poll(self) -> str | None:
        """Return the next key or line if there is one, without waiting.

        Returns
        -------
        str or None
            As `wait`; None while nothing has come, also after the end of the input.
        """
        if not self._ended and self._ready(0.0):
            self._read()
        return self._take()

    def _take(self) -> str | None:
        if not self._waiting:
            return None
        if self.single:
            taken, self._waiting = self._waiting[0], self._waiting[1:]
            return taken
        line, mark, rest = self._waiting.partition("\n")
        if not mark and not self._ended:
            return None
        self._waiting = rest
        return line + "\n"

    def _read(self) -> None:
        try:
            raw = os.read(self._descriptor, _CHUNK)
        except OSError:  # the terminal has gone
            raw = b""
        self._ended = not raw
        text = raw.decode("utf-8", errors="replace").replace("\r", "\n")
        # arrows and function keys come as a sequence behind an escape, in one piece
        self._waiting += text.partition(_ESCAPE)[0] if self.single else text

    def _ready(self, seconds: float) -> bool:
        try:
            return bool(select.select([self._descriptor], [], [], seconds)[0])
        except (OSError, ValueError):
            return sys.platform != "win32"
