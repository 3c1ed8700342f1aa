"""A serial line that takes its time: bytes between two pseudo-terminals at the wire's pace.

A pseudo-terminal passes bytes at once. This relay passes them as a wire would: a character at a
time, none before the one before it has ended, and a frame of the other direction not before the
silence between frames has passed.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from hdbench.devices.wire.address import SerialSettings

__all__ = ["PacedLine", "paced_line"]

_CHUNK = 4096
# pieces of a frame are passed on about this often; its last character comes on time
_PIECE_S = 1e-3
# how soon the relay notices that it is to end
_GRAIN_S = 0.05
_SHORT_S = 1e-4


@dataclass(slots=True)
class _Way:
    """One direction: characters on their way, and when the first of them has arrived."""

    read: int
    write: int
    waiting: bytearray = field(default_factory=bytearray)
    start_s: float = 0.0


class PacedLine:
    """Passes bytes between two descriptors at the pace of a serial line.

    Parameters
    ----------
    near, far : int
        Descriptors of host and device.
    settings : SerialSettings
        Bit rate, character and silence.
    clock : callable
        Monotonic clock, s.

    Attributes
    ----------
    passed : int
        Characters so far, both directions.
    """

    def __init__(
        self,
        near: int,
        far: int,
        settings: SerialSettings,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.passed = 0
        self._character_s = settings.character_s
        self._silence_s = settings.silence_s
        self._clock = clock
        self._ways = (_Way(near, far), _Way(far, near))
        self._free_s = clock()
        self._last: _Way | None = None

    def run(self, ended: Callable[[], bool]) -> None:
        """Pass bytes until `ended`, or until one side is gone."""
        with contextlib.suppress(OSError):
            while not ended():
                self._turn()

    def _turn(self) -> None:
        due_s = min((self._due_s(way) for way in self._ways if way.waiting), default=None)
        reads = [way.read for way in self._ways]
        for descriptor in select.select(reads, (), (), self._pause_s(due_s))[0]:
            self._take(next(way for way in self._ways if way.read == descriptor))
        now_s = self._clock()
        for way in self._ways:
            self._pass(way, now_s)

    def _pause_s(self, due_s: float | None) -> float:
        """Return how long nothing will have to be done, s."""
        if due_s is None:
            return _GRAIN_S
        # a sleep this short lasts three times as long as asked for
        wait_s = due_s - self._clock()
        return 0.0 if wait_s < _SHORT_S else min(wait_s - _SHORT_S, _GRAIN_S)

    def _take(self, way: _Way) -> None:
        """Put what has come behind what is on the wire."""
        now_s = self._clock()
        data = os.read(way.read, _CHUNK)
        if not way.waiting:
            # a frame that answers another, or follows one, begins after the silence
            way.start_s = max(now_s, self._free_s + self._silence_s)
            self._last = way
        way.waiting += data
        self._free_s = way.start_s + len(way.waiting) * self._character_s

    def _due_s(self, way: _Way) -> float:
        """Return when the next piece has arrived."""
        return min(way.start_s + len(way.waiting) * self._character_s, way.start_s + _PIECE_S)

    def _pass(self, way: _Way, now_s: float) -> None:
        if not way.waiting or now_s < self._due_s(way):
            return
        arrived = min(len(way.waiting), int((now_s - way.start_s) / self._character_s))
        if arrived <= 0:
            return
        piece = bytes(way.waiting[:arrived])
        del way.waiting[:arrived]
        way.start_s += arrived * self._character_s
        self.passed += arrived
        while piece:
            piece = piece[os.write(way.write, piece) :]


@contextmanager
def paced_line(path: str, settings: SerialSettings) -> Iterator[str]:
    """Stand between a host and a device on a pseudo-terminal, at the wire's pace (POSIX only).

    Parameters
    ----------
    path : str
        The device's terminal.
    settings : SerialSettings
        The line.

    Yields
    ------
    str
        The terminal for the host to open.

    Raises
    ------
    OSError
        If the terminal cannot be opened.
    """
    far = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(far)
    near, slave = os.openpty()
    tty.setraw(slave)
    ended = threading.Event()
    line = PacedLine(near, far, settings)
    thread = threading.Thread(target=line.run, args=(ended.is_set,), daemon=True)
    thread.start()
    try:
        yield os.ttyname(slave)
    finally:
        ended.set()
        thread.join()
        for descriptor in (near, slave, far):
            os.close(descriptor)
