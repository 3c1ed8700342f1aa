"""Transactor: one transaction at a time with a device, each with its deadline."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from hdbench.devices.wire.link import ExceptionReply, FrameError, Link, ReplyCheck, Request
from hdbench.errors import DeviceError, HdbenchError

Build = Callable[[], tuple[bytes, ReplyCheck]]
"""Makes a request and the check of its reply; called for every try."""

# a lost request or reply is repeated once, each try within half of the deadline
TWICE = 2
_ANOTHER = "another device answers at this address than before"


def was_answered(write: Callable[[], object]) -> bool:
    """Write once; without a valid answer, what became of it shows when it is read back."""
    try:
        write()
    except DeviceError as error:
        if not isinstance(error.__cause__, FrameError):
            raise
        return False
    return True


def same_reply(request: Request, shown: bytes) -> tuple[bytes, ReplyCheck]:
    """Return a request whose reply must end as it did before."""
    pdu, form = request

    def check(reply: bytes) -> None:
        form(reply)
        if not reply.endswith(shown):
            raise FrameError(_ANOTHER)

    return pdu, check


def is_disturbed(error: HdbenchError) -> bool:
    """Return whether a call failed by what came on an open line, or did not come."""
    fault = error.__cause__
    # a line that cannot be opened, or has gone, has the system's error as its cause
    return isinstance(fault, FrameError) and fault.__cause__ is None


class Transactor:
    """Base of the access to a device: every call keeps its deadline, from any thread.

    Parameters
    ----------
    link : Link
        Connection to the device; owned from now on.
    deadline_s : float
        Longest time of one call, s, the wait for another thread's transaction included.
    clock : callable, optional
        Monotonic clock, s.

    Attributes
    ----------
    where : str
        The device, for messages.
    repeats : int
        Requests that were sent again so far.
    """

    # what the device is, for messages, and what helps where it does not answer
    _kind: str
    _fix = "check power and network of the device, then run `hdbench doctor`"

    def __init__(
        self,
        link: Link,
        *,
        deadline_s: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.where = f"{self._kind} {link.where}"
        self.repeats = 0
        self._link = link
        self._deadline_s = deadline_s
        self._clock = clock
        self._lock = threading.Lock()
        self._known: tuple[tuple[bytes, ReplyCheck], ...] = ()
        link.opened = self._reopened

    def transact(self, build: Build, name: str, attempts: int) -> bytes:
        """Send a request for what is called `name` and return the PDU of its reply."""
        start_s = self._clock()
        if not self._lock.acquire(timeout=self._deadline_s):
            raise self._fault("another transaction did not end", name)
        try:
            last = None
            for attempt in range(1, attempts + 1):
                until_s = self._end_of_try(start_s, attempt, attempts)
                if not self._clock() < until_s:
                    break
                try:
                    return self._ask(build, until_s, is_read=attempts > 1)
                except ExceptionReply as reply:
                    raise self._refused(reply, name, start_s + self._deadline_s) from reply
                except FrameError as found:
                    self.repeats += attempt < attempts
                    self._failed(until_s)
                    last = found
            last = last or FrameError("no time left")
            times = f", {attempts} times" if attempts > 1 else ""
            raise self._fault(f"{last}{times} (deadline {self._deadline_s:g} s)", name) from last
        finally:
            self._lock.release()

    def recognise(self, *known: tuple[bytes, ReplyCheck]) -> None:
        """Let every later connection be to a device whose replies to these requests pass."""
        self._known = known

    def close(self) -> None:
        """Close the connection; never raises."""
        self._link.close()

    def _reopened(self, until_s: float) -> None:
        """Make sure, on a fresh connection, that no other device has taken the address over."""
        try:
            for pdu, check in self._known:
                self._send(pdu, check, until_s)
        except ExceptionReply as refused:
            raise FrameError(f"{_ANOTHER}: {refused}") from refused

    def error(self, what: str, name: str, fix: str) -> DeviceError:
        """Return an error that names a value of the device."""
        return DeviceError(what, where=self._place(name), fix=fix)

    def _place(self, name: str) -> str:
        return f"{self.where}, {name}"

    def _refused(self, reply: ExceptionReply, name: str, until_s: float) -> HdbenchError:
        """Return what the device's refusal means; it may be asked within what is left."""
        raise NotImplementedError

    def _fault(self, what: str, name: str) -> DeviceError:
        return self.error(what, name, self._fix)

    def _end_of_try(self, start_s: float, attempt: int, attempts: int) -> float:
        """Return until when one try may last."""
        return start_s + self._deadline_s * attempt / attempts

    def _ask(self, build: Build, until_s: float, *, is_read: bool) -> bytes:
        """Make one try."""
        return self._send(*build(), until_s)

    def _send(self, pdu: bytes, check: ReplyCheck, until_s: float) -> bytes:
        """Send one request."""
        return self._link.transact(pdu, check, until_s)

    def _failed(self, until_s: float) -> None:
        """Note that a try has failed."""
