"""Wake-up: a processor that does not sleep while a fast line is open."""

from __future__ import annotations

import contextlib
import os
import struct

FAST_BD = 115200
"""Bit rate above which a sleeping processor costs more than a hundredth of an exchange, bit/s.

It takes some 0.1 ms to wake, twice in an exchange: of 26 ms at 115200 bit/s, of 3.3 ms at 921600.
"""
# whoever holds it open says how long waking may take, us; Linux keeps to the shortest wish
_WISHES = "/dev/cpu_dma_latency"


def hold_wakeup() -> int | None:
    """Ask the kernel that no processor sleeps so deeply that waking takes time."""
    with contextlib.suppress(OSError):
        descriptor = os.open(_WISHES, os.O_WRONLY)
        try:
            os.write(descriptor, struct.pack("=i", 0))
        except OSError:
            os.close(descriptor)
            raise
        return descriptor
    return None


def release_wakeup(held: int | None) -> None:
    """Take the wish back; never raises."""
    if held is not None:
        with contextlib.suppress(OSError):
            os.close(held)
