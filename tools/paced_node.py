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

from hdbench.devices.emulator.node import build_core
from hdbench.devices.pymodbusparts import DecodePDU, FramerRTU
from hdbench.devices.wire.address import parse_address

sys.path.insert(0, str(Path(__file__).parent))

from reply_faults import PROFILE, CountingBench


class _Firmware:
    """Implements `linefaults.paced.Device`."""

    def __init__(self) -> None:
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
