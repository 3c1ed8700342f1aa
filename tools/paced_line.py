"""Stand between a host and an emulated node on a serial line, at the pace of a real wire.

Usage: python tools/paced_line.py rtu:///dev/pts/3?baud=115200   (ends with Ctrl-C or SIGTERM)

Prints the address for the host to open. Example, in three terminals:

    hdbench emulate --rtu --json                      # prints rtu:///dev/pts/3
    python tools/paced_line.py 'rtu:///dev/pts/3?baud=115200'   # prints rtu:///dev/pts/4?...
    hdbench run-ripple --address 'rtu:///dev/pts/4?baud=115200'
"""

from __future__ import annotations

import signal
import sys
import threading

from linefaults.paced import paced_line

from hdbench.devices.wire.address import parse_address


def main() -> int:
    """Relay until a signal comes."""
    address = parse_address(sys.argv[1])
    if address.scheme != "rtu":
        print("needed: rtu:///dev/NAME?baud=RATE", file=sys.stderr)
        return 2
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    with paced_line(address.path, address.serial) as near:
        query = sys.argv[1].partition("?")[2]
        print(f"rtu://{near}?{query}" if query else f"rtu://{near}", flush=True)
        ended.wait()
    return 0


if __name__ == "__main__":
    sys.exit(main())
