"""Links to polled devices: pymodbus as a strict client, under the deadlines of hdbench.

A reply is checked to the byte before anything is decoded.
"""

from __future__ import annotations

import math
import socket
import struct
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hdbench.devices import pymodbusparts as pm
from hdbench.devices.wire.address import Address, dial
from hdbench.devices.wire.link import FrameError, Link, Probe, ReplyCheck
from hdbench.devices.wire.rtu import RtuLink
from hdbench.devices.wire.tcp import Secure, TcpLink, left_to_connect_s, security_of
from hdbench.system.lines import Claim, PortIo, socket_io
from hdbench.system.sockets import TimedSocket

# the guard loads this module, and of hdbench nothing but the wire
if TYPE_CHECKING:
    from hdbench.profile.acquiring import TlsFiles

_INCOMPLETE = (0, 0, 0, b"")
# longest frame of the ASCII form: colon, 2 x 255 characters, end of line
_LONGEST_ASCII = 513
# the deadline of a call is that of the line
_UNLIMITED = pm.CommParams(comm_name="hdbench", timeout_connect=math.inf)


class _Bytes(pm.ModbusPDU):
    """A request or a reply as bytes: nothing is taken apart here."""

    data = b""

    def encode(self) -> bytes:
        return self.data


class _Decoder(pm.DecodePDU):
    """Lets one reply through: the one that the pending request allows."""

    check: ReplyCheck
    function = 0

    def __init__(self) -> None:
        super().__init__(False)
        self._reply = _Bytes()

    def decode(self, frame: bytes) -> pm.ModbusPDU:
        self.check(frame)
        self._reply.data = frame
        return self._reply


class _Framer(pm.FramerBase):
    """What the strict framers share: unit of the pending request, what came behind its reply."""

    unit = 0
    rest = b""
    decoder: _Decoder

    def check_unit(self, unit: int) -> None:
        if unit != self.unit:
            raise FrameError(f"unit {unit} answers; needed: {self.unit}")


class _Socket(_Framer, pm.FramerSocket):
    """Modbus TCP and UDP; pymodbus itself drops whole replies of other transactions and units."""

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        self.rest = b""
        if len(data) < 6:
            return _INCOMPLETE
        number, protocol, length = struct.unpack_from(">HHH", data)
        # unit and function code at least, 253 bytes of function code and data at most
        if protocol or not 2 <= length <= 254:
            raise FrameError(f"protocol {protocol}, length {length}: not a Modbus TCP frame")
        if len(data) < 6 + length:
            return _INCOMPLETE
        self.rest = data[6 + length :]
        return 6 + length, data[6], number, data[7 : 6 + length]


class _Rtu(_Framer, pm.FramerRTU):
    """Modbus RTU; a frame begins with the first character that comes."""

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        if len(data) < 3:
            return _INCOMPLETE
        if data[1] & 0x7F != self.decoder.function:
            raise FrameError(f"function code {data[1]} was never asked for")
        kind = self.decoder.lookupPduClass(data)
        size = 0 if kind is None else kind.calculateRtuFrameSize(data)
        if not size:
            raise FrameError(f"function code {data[1]} has no length on a serial line")
        if len(data) < size:
            return _INCOMPLETE
        if not self.check_CRC(data[: size - 2], int.from_bytes(data[size - 2 : size], "big")):
            raise FrameError("the checksum of the reply is wrong")
        self.check_unit(data[0])
        return size, data[0], 0, data[1 : size - 2]


class _Ascii(_Framer, pm.FramerAscii):
    """Modbus ASCII; a frame begins with the first character that comes."""

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        end = data.find(b"\r\n") + 2
        if not data.startswith(b":") or max(end, len(data) * (end < 2)) > _LONGEST_ASCII:
            raise FrameError(f"{data[:8]!r} begins no frame of Modbus ASCII")
        if end < 2:
            return _INCOMPLETE
        frame = data[:end]
        _, unit, _, pdu = super().decode(frame)
        # what is read as hexadecimal digits may have been written otherwise
        if not pdu or self.encode(pdu, unit, 0) != frame.upper():
            raise FrameError("the checksum of the reply is wrong")
        self.check_unit(unit)
        return end, unit, 0, pdu


_FRAMERS: dict[pm.FramerType, type[_Framer]] = {
    pm.FramerType.SOCKET: _Socket,
    pm.FramerType.RTU: _Rtu,
    pm.FramerType.ASCII: _Ascii,
}


class StrictClient(pm.ModbusBaseSyncClient):
    """Makes one transaction at a time on a line that somebody else opens, watches and closes.

    Parameters
    ----------
    form : str
        ``socket``, ``rtu`` or ``ascii``.
    unit : int
        Modbus unit identifier.
    """

    def __init__(self, form: str, unit: int) -> None:
        kind = pm.FramerType(form)
        super().__init__(kind, 0, _UNLIMITED, None, None, None)
        self._decoder = _Decoder()
        self._strict = _FRAMERS[kind](self._decoder)
        self._strict.unit = unit
        self.framer = self.transaction.framer = self._strict
        self._request = _Bytes(dev_id=unit)
        self._put: Callable[[bytes], object]
        self._get: Callable[[], bytes]

    def ask(
        self,
        pdu: bytes,
        check: ReplyCheck,
        put: Callable[[bytes], object],
        get: Callable[[], bytes],
    ) -> bytes:
        """Send one request once and return the PDU of its reply."""
        self._put, self._get = put, get
        self._decoder.check, self._decoder.function = check, pdu[0]
        self._request.function_code, self._request.data = pdu[0], pdu[1:]
        try:
            reply: Any = self.execute(False, self._request)
        except (pm.ModbusException, ValueError) as error:
            raise FrameError(str(error)) from error
        data: bytes = reply.data
        return data

    def connect(self) -> bool:
        """Return that the line is open."""
        return True

    def send(self, request: bytes, addr: tuple[Any, ...] | None = None) -> int:
        """Hand a frame to the line."""
        self._put(request)
        return len(request)

    def recv(self, size: int | None) -> bytes:
        """Return what stood behind the last reply, or what comes."""
        data, self._strict.rest = self._strict.rest, b""
        try:
            return data or self._get()
        except TimeoutError as error:
            # pymodbus would take it for the end of a time limit of its own
            raise FrameError("no valid reply in time") from error

    def forget(self) -> None:
        """Drop what stood behind the last reply: the line was closed."""
        self._strict.rest = b""


def polled_link(
    address: Address,
    *,
    unit: int = 1,
    probe: Probe | None = None,
    tls: TlsFiles | None = None,
    claim: Claim = "hold",
) -> Link:
    """Return a link to the device at `address`; nothing is opened or sent yet."""
    if address.scheme in ("rtu", "ascii"):
        return _LineLink(address, unit, probe, claim)
    if address.scheme == "rtu+tcp":
        return _RtuOverTcpLink(address, unit, probe)
    if address.scheme == "udp":
        return _UdpLink(address, unit)
    return _StreamLink(address, unit, security_of(address, tls))


class _StreamLink(TcpLink):
    """TCP and TLS."""

    def __init__(self, address: Address, unit: int, secure: Secure | None = None) -> None:
        super().__init__(address, unit, secure)
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

    _kind = socket.SOCK_DGRAM

    def _receive(self, connection: TimedSocket, until_s: float) -> bytes:
        while True:
            data = super()._receive(connection, until_s)
            # nothing follows a piece of a frame
            if len(data) == 6 + int.from_bytes(data[4:6], "big"):
                return data


class _LineLink(RtuLink):
    """RTU and ASCII on a serial port."""

    def __init__(
        self, address: Address, unit: int, probe: Probe | None, claim: Claim = "hold"
    ) -> None:
        super().__init__(address, unit, probe, claim)
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
            self._silent_from_s = time.monotonic()


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
        place = (self._address.host, self._address.port)
        return socket_io(dial(place, left_to_connect_s(until_s)))
