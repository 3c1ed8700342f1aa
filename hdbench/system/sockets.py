"""Sockets with a deadline for each call."""

from __future__ import annotations

import contextlib
import math
import select
import socket
import ssl
import struct
import time
from collections.abc import Callable

# The kernel ends a read of a socket after this time: one system call per reply where it comes in
# time. Its clock for this is coarse (10 ms at 100 Hz, 12 % later on), so a read is left to it only
# with twice as much time left, and what remains is waited for with the fine clock of `poll`.
_KERNEL_S = 0.02
_TIMEVAL = struct.Struct("@ll")


class TimedSocket:
    """Sends and receives until a moment on a clock.

    Parameters
    ----------
    connection : socket
        Connected; plain or inside TLS.
    clock : callable, optional
        Monotonic clock, s.

    Notes
    -----
    With ``poll`` a reply that comes soon takes one system call; without it, and inside TLS, two
    calls of the standard library's own time limit take its place: some 10 us more a reply.
    """

    def __init__(
        self, connection: socket.socket, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._connection = connection
        self._clock = clock
        self._poll = _poll() if not isinstance(connection, ssl.SSLSocket) else None
        if self._poll is not None:
            connection.setblocking(True)
            timeval = _TIMEVAL.pack(0, int(1e6 * _KERNEL_S))
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeval)

    def send(self, data: bytes, until_s: float) -> None:
        """Send all of it."""
        if self._poll is None:
            self._connection.settimeout(self._left_s(until_s))
            self._connection.sendall(data)
            return
        # a request fits the socket's buffer; only a device that reads nothing lets it fill
        while data:
            try:
                data = data[self._connection.send(data, socket.MSG_DONTWAIT) :]
            except BlockingIOError:
                self._wait(select.POLLOUT, until_s)

    def receive(self, size: int, until_s: float) -> bytes:
        """Return what comes, at most `size` bytes; nothing at the end of the stream."""
        if self._poll is None:
            self._connection.settimeout(self._left_s(until_s))
            return self._connection.recv(size)
        soon = until_s - self._clock() > 2.0 * _KERNEL_S
        while True:
            if not soon:
                self._wait(select.POLLIN, until_s)
            try:
                return self._connection.recv(size)
            except BlockingIOError:
                soon = False

    def close(self) -> None:
        """Close the connection; never raises."""
        with contextlib.suppress(OSError):
            self._connection.close()

    def _wait(self, event: int, until_s: float) -> None:
        """Wait by the fine clock."""
        left_s = self._left_s(until_s)
        if self._poll is not None:
            self._poll.register(self._connection, event)
            if not self._poll.poll(math.ceil(1e3 * left_s)):
                raise TimeoutError("no answer in time")

    def _left_s(self, until_s: float) -> float:
        left_s = until_s - self._clock()
        if not left_s > 0.0:
            raise TimeoutError("no time left")
        return left_s


def _poll() -> select.poll | None:
    """Return a ``poll`` object; None where the system has none, or no call that does not wait."""
    return select.poll() if hasattr(select, "poll") and hasattr(socket, "MSG_DONTWAIT") else None
