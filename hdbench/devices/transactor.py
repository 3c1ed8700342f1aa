"""Transactor: one transaction at a time with a device, each with its deadline."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import NoReturn

from hdbench.devices.wire import ExceptionReply, FrameError, Link, ReplyCheck
from hdbench.errors import DeviceError

Build = Callable[[], tuple[bytes, ReplyCheck]]
"""Makes a request and the check of its reply; called for every try."""

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
        build: Build,
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
                until_s = self._end_of_try(start_s, attempt, attempts)
                if not self._clock() < until_s:
                    break
                try:
                    return self._ask(build, until_s, is_read=attempts > 1)
                except ExceptionReply as reply:
                    refused(reply, start_s + self._deadline_s)
                except FrameError as found:
                    self.repeats += attempt < attempts
                    self._failed(until_s)
                    last = found
            times = f", {attempts} times" if attempts > 1 else ""
            raise fault(f"{last}{times} (deadline {self._deadline_s:g} s)") from last
        finally:
            self._lock.release()

    def _end_of_try(self, start_s: float, attempt: int, attempts: int) -> float:
        """Return until when one try may last."""
        return start_s + self._deadline_s * attempt / attempts

    def _ask(self, build: Build, until_s: float, *, is_read: bool) -> bytes:
        """Make one try."""
        return self._link.transact(*build(), until_s)

    def _failed(self, until_s: float) -> None:
        """Note that a try has failed."""
