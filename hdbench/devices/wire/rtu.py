"""Modbus RTU on a serial line or a pseudo-terminal."""

from __future__ import annotations

import contextlib
import struct
import time
from array import array
from collections.abc import Callable

from hdbench.devices.wire.address import Address
from hdbench.devices.wire.link import (
    ExceptionReply,
    FrameError,
    Probe,
    ReplyCheck,
    StaleReply,
    greet,
)
from hdbench.system import lines

CRC_START = 0xFFFF
"""The remainder before the first character."""
# frame lengths: replies with a byte count of their own, and those of a fixed length
_COUNTED = frozenset((1, 2, 3, 4, 23))
_ECHOED = frozenset((5, 6, 15, 16))
_ECHO_SIZE = 8
_EXCEPTION_SIZE = 5
# a line without a character for this long carries no frame of anybody
_QUIET_S = 0.05
_CHUNK = 4096
_SHORT_S = 1e-4


def _table(bits: int) -> array[int]:
    """Return the remainders of all numbers of 8 or 16 bits.

    The polynomial is 0xA001, which is 0x8005 with its bits reversed. The remainder of a sum (modulo
    2) is the sum of the remainders, so each power of two doubles the table.
    """
    table = array("H", [0])
    for bit in range(bits):
        value = 1 << bit
        for _ in range(bits):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
        table.extend([value ^ other for other in table])
    return table


_BYTES = _table(8)
# a step for two characters halves the time of a frame
_PAIRS = _table(16)


def crc_over(data: bytes, value: int = CRC_START) -> int:
    """Return the remainder after more characters; after a whole frame with its checksum it is 0.

    Notes
    -----
    "MODBUS over Serial Line Specification and Implementation Guide V1.02", section 6.2.2:
    polynomial 0xA001, start value 0xFFFF.
    """
    pairs = _PAIRS
    for pair in struct.unpack_from(f"<{len(data) // 2}H", data):
        value = pairs[value ^ pair]
    if len(data) % 2:
        value = value >> 8 ^ _BYTES[(value ^ data[-1]) & 0xFF]
    return value


def crc16(data: bytes) -> bytes:
    """Return the CRC-16 of a frame as it stands on the wire, low byte first."""
    return crc_over(data).to_bytes(2, "little")


def reply_size(data: bytes) -> int | None:
    """Return the length of the frame that begins with `data`; None while it cannot be told."""
    if len(data) < 2:
        return None
    function = data[1]
    if function & 0x80:
        return _EXCEPTION_SIZE
    if function in _ECHOED:
        return _ECHO_SIZE
    if function not in _COUNTED:
        raise FrameError(f"function code {function} was never asked for")
    return None if len(data) < 3 else 5 + data[2]


class RtuLink:
    """Implements `hdbench.devices.wire.link.Link` on a serial port.

    The line has no transaction numbers: a reply that comes late looks like the answer to the next
    request. So after any fault the line must have been quiet for 50 ms, what came is thrown away,
    and the probe's reply - of a length that nothing else has - must come before anything else.
    """

    _line = "serial port"

    def __init__(
        self, address: Address, unit: int, probe: Probe | None = None, claim: lines.Claim = "hold"
    ) -> None:
        self._claim: lines.Claim = claim
        self.where = str(address)
        self.opened: Callable[[float], None] | None = None
        self._address = address
        self._silence_s = address.serial.silence_s
        self._unit = bytes((unit,))
        self._probe = probe
        self._io: lines.PortIo | None = None
        self._awake: int | None = None
        self._received = b""
        self._doubtful = self._robbed = False
        self._probes = 0
        self._silent_from_s = 0.0

    def transact(self, pdu: bytes, check: ReplyCheck, until_s: float) -> bytes:
        """Send one request once and return the PDU of its reply."""
        self._robbed = False
        try:
            io = self._connected(until_s)
            if self._doubtful:
                self._make_sure(io, until_s)
            return self._once(io, pdu, check, until_s)
        except ExceptionReply:
            raise
        except FrameError:
            self._doubtful = True
            raise
        except OSError as error:
            self.close()
            raise FrameError(f"the {self._line} failed ({error.strerror or error})") from error

    def close(self) -> None:
        """Close the port; never raises."""
        io, self._io = self._io, None
        awake, self._awake = self._awake, None
        lines.release_wakeup(awake)
        self._received = b""
        if io is not None:
            with contextlib.suppress(OSError):
                io.close()

    def _once(self, io: lines.PortIo, pdu: bytes, check: ReplyCheck, until_s: float) -> bytes:
        frame = self._unit + pdu
        self._send(io, frame + crc16(frame), until_s)
        while True:
            reply = self._reply(io, until_s)
            try:
                check(reply)
            except StaleReply as stale:
                if not time.monotonic() < until_s:
                    raise FrameError("no valid reply in time") from stale
                continue
            return reply

    def _send(self, io: lines.PortIo, frame: bytes, until_s: float) -> None:
        """Send `frame` after the silence between frames; what came before it is thrown away."""
        self._be_silent(io, until_s)
        while True:
            # the port never blocks; a request fits its buffer
            frame = frame[io.write(frame) :]
            if not frame:
                return
            left_s = until_s - time.monotonic()
            if not left_s > 0.0 or not io.writable(left_s):
                raise FrameError("the serial port takes no characters")

    def _be_silent(self, io: lines.PortIo, until_s: float) -> None:
        """Wait for the silence between frames; characters that come begin it anew."""
        self._received = b""
        while (wait_s := self._silent_from_s + self._silence_s - time.monotonic()) > 0.0 or (
            io.readable(0.0)
        ):
            left_s = until_s - time.monotonic()
            if not left_s > 0.0:
                raise FrameError("the line is never silent")
            # a sleep this short lasts three times as long as asked for
            if io.readable(min(wait_s - _SHORT_S, left_s)) and (self._take(io)):
                self._silent_from_s = time.monotonic()

    def _reply(self, io: lines.PortIo, until_s: float) -> bytes:
        """Return function code and data of the next frame; its checksum is made as it comes."""
        data, piece = b"", self._received
        size, remainder = None, CRC_START
        while True:
            known = len(data)
            data += piece
            if size is None:
                size, known = reply_size(data), 0
            if size is not None:
                remainder = crc_over(data[known:size], remainder)
                if len(data) >= size:
                    break
            piece = self._piece(io, until_s)
        self._silent_from_s = time.monotonic()
        self._received = data[size:]
        if remainder:
            raise FrameError("the checksum of the reply is wrong")
        if data[:1] != self._unit:
            raise FrameError(f"unit {data[0]} answers; needed: {self._unit[0]}")
        return data[1 : size - 2]

    def _piece(self, io: lines.PortIo, until_s: float) -> bytes:
        """Return what has come of a reply, once something has."""
        while True:
            ready = io.readable(until_s - time.monotonic())
            piece = self._take(io) if ready else b""
            if piece:
                return piece
            if not time.monotonic() < until_s:
                other = "; another program reads from this port" if self._robbed else ""
                raise FrameError(f"no valid reply in time{other}")

    def _make_sure(self, io: lines.PortIo, until_s: float) -> None:
        """Wait for a quiet line, drop what came, and let the device say who it is."""
        fault = FrameError("the line did not become quiet in time")
        while True:
            while (left_s := until_s - time.monotonic()) > 0.0 and (
                io.readable(min(_QUIET_S, left_s))
            ):
                self._take(io)
            if not time.monotonic() < until_s:
                raise fault
            if self._probe is None:
                break
            self._probes += 1
            pdu, check = self._probe(self._probes)
            try:
                self._once(io, pdu, check, until_s)
            except ExceptionReply:
                break
            except FrameError as found:
                # an older reply: quiet again, and a probe with another length
                fault = found
                continue
            break
        self._doubtful = False

    def _take(self, io: lines.PortIo) -> bytes:
        """Return what has come; nothing where somebody else was faster."""
        data = io.read(_CHUNK)
        if not data:
            if io.is_gone():
                raise OSError(0, "it was unplugged")
            self._robbed = True
        return data

    def _connected(self, until_s: float) -> lines.PortIo:
        if self._io is None:
            io = self._io = self._opened(until_s)
            if self._address.serial.baud_bd > lines.FAST_BD:
                self._awake = lines.hold_wakeup()
            self._received = b""
            # a program before this one may have left a question open
            self._doubtful = True
            greet(self, until_s)
            return io
        return self._io

    def _opened(self, until_s: float) -> lines.PortIo:
        line = self._address.serial
        try:
            port = lines.open_port(
                self._address.path,
                self.where,
                baud_bd=line.baud_bd,
                data_bits=line.data_bits or 8,
                parity=line.parity,
                stop_bits=line.stop_bits,
                claim=self._claim,
            )
        except ValueError as error:
            raise FrameError(f"the port does not take these settings ({error})") from error
        return lines.port_io(port)
