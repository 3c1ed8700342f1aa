"""Serve a node whose samples cost nothing behind a serial line that takes a wire's time.

Usage: python tools/paced_node.py [baud=921600[&gap_us=1750]]   (ends with Ctrl-C or SIGTERM)

Prints the address for the host to open. The node sits on its line as firmware does, in the line's
own loop, so that only the host's terminal is between host and wire: a pseudo-terminal hands every
piece to a worker of the kernel first, which no wire does.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import tty
from pathlib import Path

from linefaults.paced import PacedLine

from hdbench.devices.emulator.answer import answer
from hdbench.devices.emulator.rtuserver import request_size
from hdbench.devices.emulator.serve import build_core
from hdbench.devices.wire.address import parse_address
from hdbench.devices.wire.crc import crc16

sys.path.insert(0, str(Path(__file__).parent))

from reply_faults import PROFILE, CountingBench


class _Firmware:
    """Implements `linefaults.paced.Device`."""

    def __init__(self) -> None:
        self._core = build_core(CountingBench(), PROFILE, 0, pace="fast")
        self._buffer = b""

    def received(self, data: bytes) -> bytes:
        """Answer a request once it is whole."""
        self._buffer += data
        size = request_size(self._buffer)
        if size is None or len(self._buffer) < size:
            return b""
        frame, self._buffer = self._buffer[:size], self._buffer[size:]
        if not frame or crc16(frame[:-2]) != frame[-2:]:
            # what is left of it is over when the line is silent
            self._buffer = b""
            return b""
        self._core.tick()
        reply = frame[:1] + answer(frame[1:-2], self._core, 0)
        return reply + crc16(reply)

    def rest(self) -> None:
        """Sample while the reply is on its way."""
        self._core.machine.produce_ahead()


def main() -> int:
    """Serve and relay until a signal comes."""
    query = sys.argv[1] if len(sys.argv) > 1 else "baud=921600"
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    host, slave = os.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)
    line = PacedLine(host, _Firmware(), parse_address(f"rtu://{name}?{query}").serial)
    print(f"rtu://{name}?{query}", flush=True)
    line.run(ended.is_set)
    return 0


if __name__ == "__main__":
    sys.exit(main())
