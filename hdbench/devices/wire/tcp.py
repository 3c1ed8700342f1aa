"""Modbus TCP, plain or inside TLS."""

from __future__ import annotations

import socket
import ssl
import struct
import time
from collections.abc import Callable

from hdbench.devices.wire.address import Address
from hdbench.devices.wire.checks import ExceptionReply, FrameError, ReplyCheck, StaleReply
from hdbench.devices.wire.naming import dial
from hdbench.system.sockets import TimedSocket

__all__ = ["TcpLink", "next_reply"]

_HEADER = struct.Struct(">HHHB")
# ten replies of the greatest length
_CHUNK = 2600


def next_reply(data: bytes, number: int, unit: int) -> tuple[bytes | None, bytes]:
    """Return the PDU in `data` that answers transaction `number` of `unit`, and what follows it."""
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
        self._socket: TimedSocket | None = None
        self._number = 0
        self._received = b""

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
        self._received = b""
        if connection is not None:
            connection.close()

    def _once(
        self, connection: TimedSocket, pdu: bytes, check: ReplyCheck, until_s: float
    ) -> bytes:
        self._number = number = self._number % 0xFFFF + 1
        connection.send(_HEADER.pack(number, 0, len(pdu) + 1, self._unit) + pdu, until_s)
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

    def _connected(self, until_s: float) -> TimedSocket:
        left_s = until_s - self._clock()
        if not left_s > 0.0:
            raise FrameError("no time left to connect")
        connection = self._dial(left_s)
        if self._secure is not None:
            connection = self._secured(connection, self._secure, until_s)
        timed = TimedSocket(connection, self._clock)
        self._socket, self._received = timed, b""
        if self.opened is not None:
            self.opened(until_s)
        return timed

    def _secured(
        self,
        connection: socket.socket,
        secure: Callable[[socket.socket], ssl.SSLSocket],
        until_s: float,
    ) -> socket.socket:
        try:
            left_s = until_s - self._clock()
            if not left_s > 0.0:
                raise TimeoutError
            connection.settimeout(left_s)
            return secure(connection)
        except OSError:
            connection.close()
            raise

    def _reply(self, connection: TimedSocket, number: int, until_s: float) -> bytes:
        """Return the next PDU of this transaction."""
        data = self._received or self._receive(connection, until_s)
        while True:
            reply, self._received = next_reply(data, number, self._unit)
            if reply is not None:
                return reply
            data = self._received + self._receive(connection, until_s)

    def _receive(self, connection: TimedSocket, until_s: float) -> bytes:
        chunk = connection.receive(_CHUNK, until_s)
        if not chunk:
            raise FrameError("the device closed the connection")
        return chunk

    def _describe(self, error: OSError, until_s: float) -> str:
        if isinstance(error, TimeoutError) or not self._clock() < until_s:
            return "no valid reply in time"
        if isinstance(error, ssl.SSLError):
            return f"no secure connection ({error.reason or error})"
        if isinstance(error, ConnectionResetError):
            return "the device reset the connection"
        return f"no connection ({error.strerror or error})"
