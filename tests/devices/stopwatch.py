"""Stopwatch that stands still while the thread waits for a processor.

A deadline on a shared machine is missed for no fault of the code where the scheduler gives the
time to somebody else.
"""

import time
from pathlib import Path


class Stopwatch:
    """Seconds since it was made, less those in which this thread was ready and did not run."""

    def __init__(self) -> None:
        self._start_s = _own_s()

    @property
    def s(self) -> float:
        return _own_s() - self._start_s


def _own_s() -> float:
    try:
        # nanoseconds: run, waited for a processor
        waited_ns = int(Path("/proc/thread-self/schedstat").read_text().split()[1])
    except (OSError, IndexError):
        waited_ns = 0
    return time.monotonic() - 1e-9 * waited_ns
