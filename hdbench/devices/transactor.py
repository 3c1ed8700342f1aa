"""One transaction at a time with a device, each with its deadline, some of them repeated."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import NoReturn

from hdbench.devices.wire import ExceptionReply, FrameError, Link, ReplyCheck
from hdbench.errors import DeviceError

__all__ = ["TWICE", "Transactor"]

# a lost request or reply is repeated once, each try within half of the deadline
TWICE = 2


class Transactor:
    """Sends requests; every call keeps its deadline, from any thread.

    Parameters
    ----------
    link : Link
        Connection to the device; its owner closes it.
    deadline_s : float
        Longest time of one call, s, the wait for another thread's transaction included.
    clock : callable, optional
        Monotonic clock, s.

    Attributes
    ----------
    repeats : int
        Requests that were sent again so far.
    """

    def __init__(
        self, link: Link, *, deadline_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.repeats = 0
        self._link = link
        self._deadline_s = deadline_s
        self._clock = clock
        self._lock = threading.Lock()

    def transact(
        self,
        build: Callable[[], tuple[bytes, ReplyCheck]],
        attempts: int,
        *,
        refused: Callable[[ExceptionReply, float], NoReturn],
        fault: Callable[[str], DeviceError],
    ) -> bytes:
        """Send a request and return the PDU of its reply."""
        start_s = self._clock()
        if not self._lock.acquire(timeout=self._deadline_s):
            raise fault("another transaction did not end")
        try:
            last = FrameError("no time left")
            for attempt in range(1, attempts + 1):
                until_s = start_s + self._deadline_s * attempt / attempts
                try:
                    return self._link.transact(*build(), until_s)
                except ExceptionReply as reply:
                    refused(reply, start_s + self._deadline_s)
                except FrameError as found:
                    self.repeats += attempt < attempts
                    last = found
            times = f", {attempts} times" if attempts > 1 else ""
            raise fault(f"{last}{times} (deadline {self._deadline_s:g} s)") from last
        finally:
            self._lock.release()
