"""Stop signals: noted when they come, obeyed between two transactions."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from hdbench.errors import LimitError

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


class Aborted(LimitError):  # noqa: N818 - an end that was decided, not an error
    """The operator or a safety limit ended the run; it is not resumable."""

    kind = "aborted"


class StopRequested(Exception):  # noqa: N818 - a request, not an error
    """A signal asked for the run to end."""

    def __init__(self, signum: int) -> None:
        super().__init__(signal.Signals(signum).name)
        self.signum = signum


@dataclass(slots=True)
class StopSignals:
    """What has been asked so far."""

    first: int | None = None
    count: int = 0
    raise_at_once: bool = False

    def check(self) -> None:
        """Raise `StopRequested` when a signal has come."""
        if self.first is not None:
            raise StopRequested(self.first)

    def note(self, signum: int, _frame: FrameType | None) -> None:
        """Handle a signal."""
        self.count += 1
        if self.first is None:
            self.first = signum
        if self.raise_at_once:
            raise StopRequested(self.first)

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Let a signal interrupt what runs inside: a question to a person."""
        self.check()
        self.raise_at_once = True
        try:
            yield
        finally:
            self.raise_at_once = False
        self.check()


@contextmanager
def listen() -> Iterator[StopSignals]:
    """Note Ctrl-C, SIGTERM and SIGHUP instead of dying of them."""
    signals = StopSignals()
    numbers = [getattr(signal, name) for name in _NAMES if hasattr(signal, name)]
    previous = [signal.signal(number, signals.note) for number in numbers]
    try:
        yield signals
    finally:
        for number, handler in zip(numbers, previous, strict=True):
            signal.signal(number, handler)
