"""A serial line that takes its time: bytes between two pseudo-terminals at the wire's pace.

Usage: python tools/faults/paced.py 'rtu:///dev/pts/3?baud=115200'   (ends with Ctrl-C or SIGTERM)
       python tools/faults/paced.py 'baud=921600&gap_us=1750'

A pseudo-terminal passes bytes at once. This relay passes them as a wire would: a character at a
time, none before the one before it has ended, and a frame of the other direction not before the
silence between frames has passed. It prints the address for the host to open.

With an address it stands before the emulated node there (`hdbench emulate --rtu --json` prints it).
Without one it is a node itself, whose samples cost nothing and which sits on its line as firmware
does, so that only the host's terminal is between host and wire: a pseudo-terminal hands every piece
to a worker of the kernel first, which no wire does.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

sys.path.insert(0, str(Path(__file__).parents[1]))

from faults.lines import open_terminal
from hdbench.devices.wire.address import SerialSettings, parse_address
from hdbench.system.lines import terminal_pair

__all__ = ["Device", "PacedLine", "paced_line"]

_CHUNK = 4096
# pieces of a frame are passed on about this often; its last character comes on time
_PIECE_S = 1e-3
# how soon the relay notices that it is to end
_GRAIN_S = 0.05
# a wire waits for no scheduler: what is due within this time is waited for awake
_AWAKE_S = 1e-4


class Device(Protocol):
    """A device that sits on its line without a program between."""

    def received(self, data: bytes) -> bytes:
        """Take characters that have arrived, and return the reply once a request is whole."""
        ...

    def rest(self) -> None:
        """Do what can be done while the reply is on its way."""
        ...


@dataclass(slots=True)
class _Way:
    """One direction: characters on their way, and when the first of them has set out.

    Where it leads to a `Device`, `deliver` returns the reply.
    """

    deliver: Callable[[bytes], bytes]
    waiting: bytearray = field(default_factory=bytearray)
    start_s: float = 0.0


class PacedLine:
    """Passes bytes between a host and a device at the pace of a serial line.

    Parameters
    ----------
    near : int
        Descriptor of the host.
    far : int or Device
        Descriptor of the device, or the device itself.
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
        far: int | Device,
        settings: SerialSettings,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.passed = 0
        self._character_s = settings.character_s
        self._silence_s = settings.silence_s
        self._clock = clock
        self._device: Device | None = None
        back = _Way(_writer(near))
        if isinstance(far, int):
            there = _Way(_writer(far))
            self._ends = {near: there, far: back}
        else:
            self._device, there = far, _Way(far.received)
            self._ends = {near: there}
        self._ways = (there, back)
        self._free_s = clock()

    def run(self, ended: Callable[[], bool]) -> None:
        """Pass bytes until `ended`, or until one side is gone."""
        with contextlib.suppress(OSError):
            while not ended():
                self._turn()

    def _turn(self) -> None:
        due_s = min((self._due_s(way) for way in self._ways if way.waiting), default=None)
        for descriptor in select.select(tuple(self._ends), (), (), self._pause_s(due_s))[0]:
            self._put(self._ends[descriptor], os.read(descriptor, _CHUNK))
        for way in self._ways:
            self._pass(way)

    def _pause_s(self, due_s: float | None) -> float:
        """Return how long nothing will have to be done, s."""
        if due_s is None:
            return _GRAIN_S
        wait_s = due_s - self._clock()
        return 0.0 if wait_s < _AWAKE_S else min(wait_s - _AWAKE_S, _GRAIN_S)

    def _put(self, way: _Way, data: bytes) -> None:
        """Put what has come behind what is on the wire."""
        if not way.waiting:
            # a frame that answers another, or follows one, begins after the silence
            way.start_s = max(self._clock(), self._free_s + self._silence_s)
        way.waiting += data
        self._free_s = way.start_s + len(way.waiting) * self._character_s

    def _due_s(self, way: _Way) -> float:
        """Return when the next piece has arrived."""
        return min(way.start_s + len(way.waiting) * self._character_s, way.start_s + _PIECE_S)

    def _pass(self, way: _Way) -> None:
        if not way.waiting:
            return
        due_s, now_s = self._due_s(way), self._clock()
        if due_s - now_s > _AWAKE_S:
            return
        while now_s < due_s:
            now_s = self._clock()
        arrived = min(len(way.waiting), int((now_s - way.start_s) / self._character_s + 1e-9))
        piece = bytes(way.waiting[:arrived])
        del way.waiting[:arrived]
        way.start_s += arrived * self._character_s
        self.passed += arrived
        reply = way.deliver(piece)
        if reply and self._device is not None:
            self._put(self._ways[1], reply)
            self._device.rest()


def _writer(descriptor: int) -> Callable[[bytes], bytes]:
    """Return what writes to a descriptor; it answers nothing by itself."""

    def write(data: bytes) -> bytes:
        while data:
            data = data[os.write(descriptor, data) :]
        return b""

    return write


@contextmanager
def paced_line(path: str, settings: SerialSettings) -> Iterator[str]:
    """Stand between a host and a device on a pseudo-terminal, at the wire's pace (POSIX only)."""
    far = open_terminal(path)
    near, slave, here = terminal_pair(blocking=True)
    ended = threading.Event()
    line = PacedLine(near, far, settings)
    thread = threading.Thread(target=line.run, args=(ended.is_set,), daemon=True)
    thread.start()
    try:
        yield here
    finally:
        ended.set()
        thread.join()
        for descriptor in (near, slave, far):
            os.close(descriptor)


class _Firmware:
    """A node whose samples cost nothing; implements `Device`."""

    def __init__(self) -> None:
        from faults.replies import PROFILE, CountingBench
        from hdbench.devices.emulator.node import build_core
        from hdbench.devices.pymodbusparts import DecodePDU, FramerRTU

        self._device = build_core(CountingBench(), PROFILE, 0, pace="fast")
        self._framer = FramerRTU(DecodePDU(True))
        self._buffer = b""

    def received(self, data: bytes) -> bytes:
        """Answer a request once it is whole."""
        self._buffer += data
        used, unit, _, pdu = self._framer.decode(self._buffer)
        self._buffer = self._buffer[used:]
        if not pdu:
            return b""
        self._device.tick()
        reply = self._device.answer(pdu, 0)
        return b"" if reply is None else self._framer.encode(reply, unit, 0)

    def rest(self) -> None:
        """Sample while the reply is on its way."""
        self._device.rest()


def main() -> int:
    """Serve or relay until a signal comes."""
    asked = sys.argv[1] if len(sys.argv) > 1 else "baud=921600"
    address, _, query = asked.rpartition("?")
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    if asked.startswith("rtu://"):
        there = parse_address(asked)
        with paced_line(there.path, there.serial) as near:
            print(f"rtu://{near}?{query}" if address else f"rtu://{near}", flush=True)
            ended.wait()
        return 0
    host, _, name = terminal_pair(blocking=True)
    line = PacedLine(host, _Firmware(), parse_address(f"rtu://{name}?{query}").serial)
    print(f"rtu://{name}?{query}", flush=True)
    line.run(ended.is_set)
    return 0


if __name__ == "__main__":
    sys.exit(main())
