"""Links to polled devices: pymodbus as a strict client, under the deadlines of hdbench.

A reply is checked to the byte before anything is decoded.
"""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from hdbench.devices import pymodbusparts as pm
from hdbench.devices.wire.address import Address, dial
from hdbench.devices.wire.link import FrameError, Link, Probe, ReplyCheck
from hdbench.devices.wire.rtu import RtuLink
from hdbench.devices.wire.tcp import HEADER, Secure, TcpLink, left_to_connect_s, security_of
from hdbench.system.lines import Claim, PortIo, socket_io
from hdbench.system.sockets import TimedSocket

# the guard loads this module, and of hdbench nothing but the wire
if TYPE_CHECKING:
    from hdbench.profile.acquiring import TlsFiles

_INCOMPLETE = (0, 0, 0, b"")
# longest frame of the ASCII form: colon, 2 x 255 characters, end of line
_LONGEST_ASCII = 513
_Put = Callable[[Any, bytes, float], object]
_Get = Callable[[Any, float], bytes]
# the deadline of a call is that of the line
_UNLIMITED = pm.CommParams(comm_name="hdbench", timeout_connect=math.inf)


class _Bytes(pm.ModbusPDU):
    """A request or a reply as bytes: nothing is taken apart here."""

    data = b""


class _Framer(pm.FramerBase):
    """Lets one reply through: the one that the pending request allows."""

    check: ReplyCheck
    function = unit = 0
    # what came behind the reply
    rest = b""

    def __init__(self) -> None:
        super().__init__(pm.DecodePDU(False))
        self._reply = _Bytes()

    def buildFrame(self, message: Any) -> bytes:  # noqa: N802 - pymodbus' name
        return self.encode(message.data, message.dev_id, message.transaction_id)

    def handleFrame(  # noqa: N802 - pymodbus' name
        self, data: bytes, exp_devid: int, exp_tid: int
    ) -> tuple[int, pm.ModbusPDU | None]:
        used, unit, number, pdu = 0, -1, -1, b""
        # whole replies of other transactions and units are passed over
        while unit != exp_devid or number != exp_tid:
            size, unit, number, pdu = self.decode(data[used:])
            if not size:
                return used, None
            used += size
        self.check(pdu)
        self._reply.data = pdu
        return used, self._reply

    def check_unit(self, unit: int) -> None:
        if unit != self.unit:
            raise FrameError(f"unit {unit} answers; needed: {self.unit}")


class _Socket(_Framer, pm.FramerSocket):
    """Modbus TCP and UDP."""

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        self.rest = b""
        if len(data) < 7:
            return _INCOMPLETE
        number, protocol, length, unit = HEADER.unpack_from(data)
        # unit and function code at least, 253 bytes of function code and data at most
        if protocol or not 2 <= length <= 254:
            raise FrameError(f"protocol {protocol}, length {length}: not a Modbus TCP frame")
        end = 6 + length
        if len(data) < end:
            return _INCOMPLETE
        self.rest = data[end:]
        return end, unit, number, data[7:end]

    def encode(self, payload: bytes, device_id: int, tid: int) -> bytes:
        return HEADER.pack(tid, 0, len(payload) + 1, device_id) + payload


class _Rtu(_Framer, pm.FramerRTU):
    """Modbus RTU; a frame begins with the first character that comes."""

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        if len(data) < 3:
            return _INCOMPLETE
        if data[1] & 0x7F != self.function:
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
    put : callable
        Takes the line, a frame and the latest end on the clock, s, and sends it.
    get : callable
        Takes the line and that end, and returns what comes.
    """

    def __init__(self, form: str, unit: int, put: _Put, get: _Get) -> None:
        kind = pm.FramerType(form)
        super().__init__(kind, 0, _UNLIMITED, None, None, None)
        self._strict = _FRAMERS[kind]()
        self._strict.unit = unit
        self.framer = self.transaction.framer = self._strict
        self._request = _Bytes(dev_id=unit)
        self._put, self._get = put, get
        self._line: Any = None
        self._until_s = 0.0

    def ask(self, line: object, pdu: bytes, check: ReplyCheck, until_s: float) -> bytes:
        """Send one request once and return the PDU of its reply."""
        self._line, self._until_s = line, until_s
        request, turn = self._request, self.transaction
        self._strict.check, self._strict.function = check, pdu[0]
        request.data, request.transaction_id = pdu, turn.getNextTID()
        try:
            # one send and one reply: what pymodbus repeats stands around these
            turn.pdu_send(request)
            reply: Any = turn.sync_get_response(request.dev_id, request.transaction_id)
        except TimeoutError as error:
            raise FrameError("no valid reply in time") from error
        except (pm.ModbusException, ValueError) as error:
            raise FrameError(str(error)) from error
        data: bytes = reply.data
        return data

    def send(self, request: bytes, addr: tuple[Any, ...] | None = None) -> int:
        """Hand a frame to the line."""
        self._put(self._line, request, self._until_s)
        return len(request)

    def recv(self, size: int | None) -> bytes:
        """Return what stood behind the last reply, or what comes."""
        data, self._strict.rest = self._strict.rest, b""
        return data or self._get(self._line, self._until_s)

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
        self._client = StrictClient("socket", unit, TimedSocket.send, self._receive)

    def close(self) -> None:
        """Close the connection; never raises."""
        super().close()
        self._client.forget()

    def _once(
        self, connection: TimedSocket, pdu: bytes, check: ReplyCheck, until_s: float
    ) -> bytes:
        return self._client.ask(connection, pdu, check, until_s)


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
        form = "ascii" if address.scheme == "ascii" else "rtu"
        self._client = StrictClient(form, unit, self._send, self._piece)

    def _once(self, io: PortIo, pdu: bytes, check: ReplyCheck, until_s: float) -> bytes:
        try:
            return self._client.ask(io, pdu, check, until_s)
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
