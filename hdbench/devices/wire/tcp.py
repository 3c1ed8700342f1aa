"""Modbus TCP, plain or inside TLS with a certificate on either side."""

from __future__ import annotations

import socket
import ssl
import stat
import struct
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from hdbench.devices.wire.address import Address, dial
from hdbench.devices.wire.link import ExceptionReply, FrameError, ReplyCheck, StaleReply, greet
from hdbench.errors import UsageError
from hdbench.system.files import is_private
from hdbench.system.sockets import TimedSocket

if TYPE_CHECKING:
    from hdbench.profile.acquiring import TlsFiles

HEADER = struct.Struct(">HHHB")
"""Before each PDU: transaction, protocol 0, bytes that follow, unit."""
# ten replies of the greatest length
_CHUNK = 2600


Secure = Callable[[socket.socket], ssl.SSLSocket]
"""Wraps a fresh connection in TLS."""


def security_of(address: Address, files: TlsFiles | None) -> Secure | None:
    """Return what wraps a connection to `address` in mutual TLS; None where it is no TLS.

    TLS 1.2 or newer, both certificates checked, as "MODBUS/TCP Security Protocol Specification"
    v36 (2021) asks. There is no way to switch the check off.
    """
    if address.scheme != "tls":
        return None
    if files is None:
        raise UsageError(
            f"tls://{address.host} needs certificates; found none",
            where="key daq.tls",
            fix="add [daq.tls] with certificate, key and authority",
        )
    _check_key(Path(files.key))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    name = "authority"
    try:
        context.load_verify_locations(files.authority)
        name = "certificate"
        context.load_cert_chain(files.certificate, files.key)
    except (OSError, ValueError) as error:
        raise UsageError(
            f"the {name} cannot be used ({error})",
            where=f"key daq.tls.{name}",
            fix="give the path of a PEM file that this user can read",
        ) from error
    return partial(context.wrap_socket, server_hostname=files.server_name or address.host)


def _check_key(path: Path) -> None:
    """Refuse a private key that others may read."""
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise UsageError(
            f"{path} cannot be read ({error.strerror})",
            where="key daq.tls.key",
            fix="give the path of the private key's PEM file",
        ) from error
    if not is_private(mode):
        raise UsageError(
            f"{path} has mode {stat.S_IMODE(mode):04o}; needed: 0600, nobody else may read it",
            where="key daq.tls.key",
            fix=f"chmod 600 {path}",
        )


def next_reply(data: bytes, number: int, unit: int) -> tuple[bytes | None, bytes]:
    """Return the PDU in `data` that answers transaction `number` of `unit`, and what follows it."""
    while len(data) >= 7:
        found, protocol, length, found_unit = HEADER.unpack_from(data)
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


def left_to_connect_s(until_s: float) -> float:
    """Return the time left until a moment, s; raises `FrameError` where there is none."""
    left_s = until_s - time.monotonic()
    if not left_s > 0.0:
        raise FrameError("no time left to connect")
    return left_s


class TcpLink:
    """Implements `hdbench.devices.wire.link.Link` on a TCP connection.

    The address has the host's number, as `numbered` gives it. Transaction numbers go on across
    connections, and after any fault the connection is closed: no late reply can be taken for a
    later one.
    """

    _kind = socket.SOCK_STREAM

    def __init__(self, address: Address, unit: int, secure: Secure | None = None) -> None:
        self.where = str(address)
        self.opened: Callable[[float], None] | None = None
        self._target = (address.host, address.port)
        self._unit = unit
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
        connection.send(HEADER.pack(number, 0, len(pdu) + 1, self._unit) + pdu, until_s)
        while True:
            data = self._received or self._receive(connection, until_s)
            reply, self._received = next_reply(data, number, self._unit)
            if reply is None:
                self._received += self._receive(connection, until_s)
                continue
            try:
                check(reply)
            except StaleReply:
                continue
            return reply

    def _connected(self, until_s: float) -> TimedSocket:
        connection = dial(self._target, left_to_connect_s(until_s), self._kind)
        if self._secure is not None:
            try:
                connection.settimeout(left_to_connect_s(until_s))
                connection = self._secure(connection)
            except (OSError, FrameError):
                connection.close()
                raise
        timed = TimedSocket(connection)
        self._socket, self._received = timed, b""
        greet(self, until_s)
        return timed

    def _receive(self, connection: TimedSocket, until_s: float) -> bytes:
        chunk = connection.receive(_CHUNK, until_s)
        if not chunk:
            raise FrameError("the device closed the connection")
        return chunk

    def _describe(self, error: OSError, until_s: float) -> str:
        if isinstance(error, TimeoutError) or not time.monotonic() < until_s:
            return "no valid reply in time"
        if isinstance(error, ssl.SSLError):
            return f"no secure connection ({error.reason or error})"
        if isinstance(error, ConnectionResetError):
            return "the device reset the connection"
        return f"no connection ({error.strerror or error})"
