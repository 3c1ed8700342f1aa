"""Keys of a person: single ones on a terminal, lines elsewhere."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from hdbench.system.keyboard import keyboard

END = ""
"""What `Keys.wait` returns when nobody can answer any more."""

_ESCAPE = "\x1b"
_STANDARD_INPUT = 0


class Keys:
    """Reads what a person presses.

    Notes
    -----
    On a terminal a key counts as soon as it is pressed, without echo; Ctrl-C stays a signal.
    Elsewhere a line counts: its words, then Enter.
    """

    def __init__(self) -> None:
        self._keyboard = keyboard(_STANDARD_INPUT)
        self.terminal = os.isatty(_STANDARD_INPUT)
        self.single = False
        self._waiting = ""
        self._ended = False

    @contextmanager
    def opened(self) -> Iterator[Keys]:
        """Take single keys from a terminal until the end of the block."""
        self.single = self.terminal and self._keyboard.take_single()
        try:
            yield self
        finally:
            self._keyboard.give_back()
            self.single = False

    def forget(self) -> None:
        """Drop what was typed ahead on a terminal: an answer belongs to the question before it."""
        if self.single:
            self._keyboard.take_single()  # a stop with Ctrl-Z may have changed the terminal
            while self._keyboard.ready(0.0) and not self._ended:
                self._read()
            self._waiting = ""

    def wait(self) -> str:
        """Wait for a key or a line."""
        while True:
            taken = self._take()
            if taken is not None:
                return taken
            if self._ended:
                return END
            self._read()

    def poll(self) -> str | None:
        """Return the next key or line if there is one, without waiting."""
        if not self._ended and self._keyboard.ready(0.0):
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
        raw = self._keyboard.read()
        self._ended = not raw
        text = raw.decode("utf-8", errors="replace").replace("\r", "\n")
        # arrows and function keys come as a sequence behind an escape, in one piece
        self._waiting += text.partition(_ESCAPE)[0] if self.single else text
