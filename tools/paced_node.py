"""Serve a node whose samples cost nothing behind a serial line that takes a wire's time.

Usage: python tools/paced_node.py [baud=921600[&gap_us=1750]]   (ends with Ctrl-C or SIGTERM)

Prints the address for the host to open. Node and line are two processes on a pair of sockets, so
that only the host's own terminal is between host and wire: a pseudo-terminal hands every piece to a
worker of the kernel first, which no wire does.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import tty
from pathlib import Path

from hdbench.devices.emulator.answer import answer
from hdbench.devices.emulator.paced import PacedLine
from hdbench.devices.emulator.rtuserver import request_size
from hdbench.devices.emulator.serve import build_core
from hdbench.devices.wire.address import parse_address
from hdbench.devices.wire.crc import crc16

sys.path.insert(0, str(Path(__file__).parent))

from reply_faults import PROFILE, CountingBench


def _serve(line: socket.socket) -> None:
    """Answer requests until the line is closed: a loop without anything else, as firmware has."""
    core = build_core(CountingBench(), PROFILE, 0, pace="fast")
    buffer = b""
    while data := line.recv(4096):
        buffer += data
        while (size := request_size(buffer)) is not None and len(buffer) >= size:
            frame, buffer = buffer[:size], buffer[size:]
            if not frame or crc16(frame[:-2]) != frame[-2:]:
                # what is left of it is over when the line is silent
                buffer = b""
                break
            core.tick()
            reply = frame[:1] + answer(frame[1:-2], core, 0)
            line.sendall(reply + crc16(reply))
        # the reply is on its way: produce while the host works on it
        core.machine.produce_ahead()


def main() -> int:
    """Serve and relay until a signal comes."""
    query = sys.argv[1] if len(sys.argv) > 1 else "baud=921600"
    near, far = socket.socketpair()
    child = os.fork()
    if not child:
        near.close()
        _serve(far)
        return 0
    far.close()
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    host, slave = os.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)
    line = PacedLine(host, near.fileno(), parse_address(f"rtu://{name}?{query}").serial)
    print(f"rtu://{name}?{query}", flush=True)
    try:
        line.run(ended.is_set)
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    return 0


if __name__ == "__main__":
    sys.exit(main())
