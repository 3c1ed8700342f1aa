"""Connections to polled devices: the deadlines are hdbench's, the protocol is pymodbus'."""

from __future__ import annotations

import select
import socket
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from hdbench.devices.modbus.client import StrictClient
from hdbench.devices.serialport import Claim
from hdbench.devices.wire.address import Address
from hdbench.devices.wire.checks import FrameError, ReplyCheck
from hdbench.devices.wire.link import Link, Probe
from hdbench.devices.wire.naming import dial
from hdbench.devices.wire.rtu import RtuLink
from hdbench.devices.wire.tcp import TcpLink
from hdbench.system.lines import PortIo
from hdbench.system.sockets import TimedSocket

if TYPE_CHECKING:
    import ssl

    from hdbench.devices.wire.tls import Certificates

__all__ = ["polled_link"]


def polled_link(
    address: Address,
    *,
    unit: int = 1,
    probe: Probe | None = None,
    tls: Certificates | None = None,
    claim: Claim = "hold",
    clock: Callable[[], float] = time.monotonic,
) -> Link:
    """Return a link to the device at `address`; nothing is opened or sent yet."""
    if address.scheme in ("rtu", "ascii"):
        return _LineLink(address, unit, probe, clock, claim)
    if address.scheme == "rtu+tcp":
        return _RtuOverTcpLink(address, unit, probe, clock)
    if address.scheme == "udp":
        return _UdpLink(address, unit, clock)
    if address.scheme == "tls":
        from hdbench.devices.wire.tls import client_security

        return _StreamLink(address, unit, clock, client_security(address, tls))
    return _StreamLink(address, unit, clock)


class _StreamLink(TcpLink):
    """TCP and TLS."""

    def __init__(
        self,
        address: Address,
        unit: int,
        clock: Callable[[], float],
        secure: Callable[[socket.socket], ssl.SSLSocket] | None = None,
    ) -> None:
        super().__init__(address, unit, clock, secure)
        self._client = StrictClient("socket", unit)

    def close(self) -> None:
        """Close the connection; never raises."""
        super().close()
        self._client.forget()

    def _once(
        self, connection: TimedSocket, pdu: bytes, check: ReplyCheck, until_s: float
    ) -> bytes:
        return self._client.ask(
            pdu,
            check,
            lambda frame: connection.send(frame, until_s),
            lambda: self._receive(connection, until_s),
        )


class _UdpLink(_StreamLink):
    """UDP: each datagram is a frame."""

    def _dial(self, left_s: float) -> socket.socket:
        return dial(self._target, left_s, socket.SOCK_DGRAM)

    def _receive(self, connection: TimedSocket, until_s: float) -> bytes:
        while True:
            data = super()._receive(connection, until_s)
            # nothing follows a piece of a frame
            if len(data) == 6 + int.from_bytes(data[4:6], "big"):
                return data


class _LineLink(RtuLink):
    """RTU and ASCII on a serial port."""

    def __init__(
        self,
        address: Address,
        unit: int,
        probe: Probe | None,
        clock: Callable[[], float],
        claim: Claim = "hold",
    ) -> None:
        super().__init__(address, unit, probe, clock, claim)
        self._client = StrictClient("ascii" if address.scheme == "ascii" else "rtu", unit)

    def _once(self, io: PortIo, pdu: bytes, check: ReplyCheck, until_s: float) -> bytes:
        try:
            return self._client.ask(
                pdu,
                check,
                lambda frame: self._send(io, frame, until_s),
                lambda: self._piece(io, until_s),
            )
        finally:
            self._silent_from_s = self._clock()


class _RtuOverTcpLink(_LineLink):
    """RTU through a serial server: as on a line, and closed after any fault."""

    _line = "connection"

    def transact(self, pdu: bytes, check: ReplyCheck, until_s: float) -> bytes:
        """Send one request once and return the PDU of its reply."""
        try:
            return super().transact(pdu, check, until_s)
        except FrameError:
            self.close()
            raise

    def _opened(self, until_s: float) -> PortIo:
        left_s = until_s - self._clock()
        if not left_s > 0.0:
            raise FrameError("no time left to connect")
        connection = dial((self._address.host, self._address.port), left_s)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setblocking(False)
        return _SocketIo(connection)


class _SocketIo:
    """Implements `hdbench.system.lines.PortIo` on a connection."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def readable(self, wait_s: float) -> bool:
        return bool(select.select((self._connection,), (), (), max(0.0, wait_s))[0])

    def writable(self, wait_s: float) -> bool:
        return bool(select.select((), (self._connection,), (), max(0.0, wait_s))[1])

    def read(self, size: int) -> bytes:
        data = self._connection.recv(size)
        if not data:
            raise OSError(0, "the device closed it")
        return data

    def write(self, data: bytes) -> int:
        try:
            return self._connection.send(data)
        except BlockingIOError:
            return 0

    def is_gone(self) -> bool:
        return False

    def close(self) -> None:
        self._connection.close()
