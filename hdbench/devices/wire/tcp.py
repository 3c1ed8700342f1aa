"""Modbus TCP, plain or inside TLS."""

from __future__ import annotations

import contextlib
import math
import select
import socket
import ssl
import struct
import time
from collections.abc import Callable

from hdbench.devices.wire.address import Address
from hdbench.devices.wire.checks import ExceptionReply, FrameError, ReplyCheck, StaleReply
from hdbench.devices.wire.naming import dial

__all__ = ["TcpLink", "next_reply"]

_HEADER = struct.Struct(">HHHB")
# ten replies of the greatest length
_CHUNK = 2600
# The kernel ends a read of a socket after this time: one system call per reply where it comes in
# time. Its clock for this is coarse (10 ms at 100 Hz, 12 % later on), so a read is left to it only
# with twice as much time left, and what remains is waited for with the fine clock of `poll`.
_KERNEL_S = 0.02
_TIMEVAL = struct.Struct("@ll")
_POLLS = hasattr(select, "poll")


def next_reply(data: bytes, number: int, unit: int) -> tuple[bytes | None, bytes]:
    """Return the PDU in `data` that answers transaction `number` of `unit`, and what follows it.

    Parameters
    ----------
    data : bytes
        Everything received and not yet consumed, frame boundaries first.
    number, unit : int
        Transaction and unit identifier of the request.

    Returns
    -------
    tuple of bytes or None, and bytes
        Function code and data, None while incomplete; what is left. Whole frames of other
        transactions or units are skipped.

    Raises
    ------
    FrameError
        If the stream is not Modbus TCP.
    """
    while len(data) >= 7:
        found, protocol, length, found_unit = _HEADER.unpack_from(data)
        # unit and function code at least, 253 bytes of PDU at most
        if protocol != 0 or not 2 <= length <= 254:
            raise FrameError(f"protocol {protocol}, length {length}: not a Modbus TCP frame")
        end = 6 + length
        if len(data) < end:
            break
        frame, data = data[7:end], data[end:]
        if found == number and found_unit == unit:
            return frame, data
    return None, data


class TcpLink:
    """Implements `hdbench.devices.wire.link.Link` on a TCP connection.

    Parameters
    ----------
    address : Address
        Number of the host, as `numbered` gives it, and port.
    unit : int
        Modbus unit identifier.
    clock : callable
        Monotonic clock, s.
    secure : callable, optional
        Wraps a fresh connection in TLS.

    Notes
    -----
    Transaction numbers go on across connections, and after any fault the connection is closed: no
    late reply can be taken for a later one.
    """

    def __init__(
        self,
        address: Address,
        unit: int,
        clock: Callable[[], float] = time.monotonic,
        secure: Callable[[socket.socket], ssl.SSLSocket] | None = None,
    ) -> None:
        self.where = str(address)
        self.opened: Callable[[float], None] | None = None
        self._target = (address.host, address.port)
        self._unit = unit
        self._clock = clock
        self._secure = secure
        self._socket: socket.socket | None = None
        self._number = 0
        self._received = b""
        self._poller: select.poll | None = None

    def transact(self, pdu: bytes, check: ReplyCheck, until_s: float) -> bytes:
        """Send one request once and return the PDU of its reply."""
        try:
            connection = self._socket or self._connected(until_s)
            return self._once(connection, pdu, check, until_s)
        except ExceptionReply:
            raise
        except FrameError:
            self.close()
            raise
        except OSError as error:
            self.close()
            raise FrameError(self._describe(error, until_s)) from error

    def close(self) -> None:
        """Close the connection; never raises."""
        connection, self._socket = self._socket, None
        self._received, self._poller = b"", None
        if connection is not None:
            with contextlib.suppress(OSError):
                connection.close()

    def _once(
        self, connection: socket.socket, pdu: bytes, check: ReplyCheck, until_s: float
    ) -> bytes:
        self._number = number = self._number % 0xFFFF + 1
        self._send(connection, _HEADER.pack(number, 0, len(pdu) + 1, self._unit) + pdu, until_s)
        while True:
            reply = self._reply(connection, number, until_s)
            try:
                check(reply)
            except StaleReply:
                continue
            return reply

    def _dial(self, left_s: float) -> socket.socket:
        connection = dial(self._target, left_s)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection

    def _connected(self, until_s: float) -> socket.socket:
        left_s = until_s - self._clock()
        if not left_s > 0.0:
            raise FrameError("no time left to connect")
        connection = self._dial(left_s)
        if self._secure is not None:
            connection = self._secured(connection, self._secure, until_s)
        elif _POLLS:
            connection.setblocking(True)
            timeval = _TIMEVAL.pack(0, int(1e6 * _KERNEL_S))
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeval)
            self._poller = select.poll()
        self._socket, self._received = connection, b""
        if self.opened is not None:
            self.opened(until_s)
        return connection

    def _secured(
        self,
        connection: socket.socket,
        secure: Callable[[socket.socket], ssl.SSLSocket],
        until_s: float,
    ) -> socket.socket:
        try:
            self._wait(connection, until_s)
            return secure(connection)
        except (OSError, FrameError):
            connection.close()
            raise

    def _reply(self, connection: socket.socket, number: int, until_s: float) -> bytes:
        """Return the next PDU of this transaction."""
        data = self._received or self._receive(connection, until_s)
        while True:
            reply, self._received = next_reply(data, number, self._unit)
            if reply is not None:
                return reply
            data = self._received + self._receive(connection, until_s)

    def _send(self, connection: socket.socket, frame: bytes, until_s: float) -> None:
        if self._poller is None:
            self._wait(connection, until_s)
            connection.sendall(frame)
            return
        # a request fits the socket's buffer; only a device that reads nothing lets it fill
        while frame:
            with contextlib.suppress(BlockingIOError):
                frame = frame[connection.send(frame, socket.MSG_DONTWAIT) :]
            if frame:
                self._ready(connection, select.POLLOUT, until_s)

    def _receive(self, connection: socket.socket, until_s: float) -> bytes:
        """Return what comes; by one system call where it comes soon."""
        soon = until_s - self._clock() > 2.0 * _KERNEL_S
        while True:
            if self._poller is None:
                self._wait(connection, until_s)
            elif not soon:
                self._ready(connection, select.POLLIN, until_s)
            try:
                chunk = connection.recv(_CHUNK)
            except BlockingIOError:
                soon = False
                continue
            if not chunk:
                raise FrameError("the device closed the connection")
            return chunk

    def _ready(self, connection: socket.socket, event: int, until_s: float) -> None:
        """Wait for a connection by the fine clock."""
        left_s = until_s - self._clock()
        poller = self._poller
        if poller is None or not left_s > 0.0:
            raise FrameError("no valid reply in time")
        poller.register(connection, event)
        if not poller.poll(math.ceil(1e3 * left_s)):
            raise FrameError("no valid reply in time")

    def _wait(self, connection: socket.socket, until_s: float) -> None:
        """Let the next call on the connection end by `until_s`."""
        left_s = until_s - self._clock()
        if not left_s > 0.0:
            raise FrameError("no valid reply in time")
        connection.settimeout(left_s)

    def _describe(self, error: OSError, until_s: float) -> str:
        if isinstance(error, TimeoutError) or not self._clock() < until_s:
            return "no valid reply in time"
        if isinstance(error, ssl.SSLError):
            return f"no secure connection ({error.reason or error})"
        if isinstance(error, ConnectionResetError):
            return "the device reset the connection"
        return f"no connection ({error.strerror or error})"
