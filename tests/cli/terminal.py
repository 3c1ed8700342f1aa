"""A person at a pseudo-terminal: reads what is shown, presses keys."""

import fcntl
import os
import pty
import re
import select
import struct
import termios
import time
from collections.abc import Sequence

from forked import hdbench_process

_CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\r")


class Person:
    """One command on a terminal of 80 x 24."""

    def __init__(self, arguments: Sequence[object], *, term: str = "xterm") -> None:
        self.master, slave = pty.openpty()
        self.resize(24, 80)
        streams = dict.fromkeys(("stdin", "stdout", "stderr"), slave)
        self.process = hdbench_process(arguments, terminal=True, env={"TERM": term}, **streams)
        os.close(slave)
        self.raw = ""
        self.seen = 0

    @property
    def text(self) -> str:
        """Everything shown, without control sequences."""
        return _CONTROL.sub("", self.raw)

    def resize(self, rows: int, columns: int) -> None:
        fcntl.ioctl(self.master, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def wait_for(self, pattern: str) -> None:
        """Wait until `pattern` is shown."""
        until, goes_on = time.monotonic() + 60.0, True
        wanted = re.compile(pattern, re.DOTALL)
        while not (found := wanted.search(self.text, self.seen)):
            shown = self.text[self.seen :][-600:]
            assert goes_on, f"ended; waited for {pattern!r}, saw {shown!r}"
            assert time.monotonic() < until, f"waited for {pattern!r}, saw {shown!r}"
            goes_on = self.look(0.2)
        self.seen = found.end()

    def answer(self, pattern: str, keys: str) -> None:
        """Wait for a question and press keys."""
        self.wait_for(pattern + r".*?\n  > ")
        self.press(keys)

    def press(self, keys: str) -> None:
        os.write(self.master, keys.encode())

    def end(self) -> int:
        """Wait for the end of the command and return its exit code."""
        until = time.monotonic() + 60.0
        while self.look(0.1):
            assert time.monotonic() < until, f"does not end: {self.text[-600:]!r}"
        os.close(self.master)
        return self.process.wait(60)

    def look(self, seconds: float) -> bool:
        """Take what is shown; False once the terminal is closed."""
        if select.select([self.master], [], [], seconds)[0]:
            try:
                raw = os.read(self.master, 65536)
            except OSError:
                return False
            self.raw += raw.decode(errors="replace")
            return bool(raw)
        return self.process.poll() is None
