"""Where a frame ends on the wire, and what in it is function code and data."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Protocol

__all__ = ["COUNTED", "ECHOED", "Framing", "RawFraming", "RtuFraming", "TcpFraming"]

_HEADER = struct.Struct(">HHHB")
COUNTED = (1, 2, 3, 4, 23)
"""Function codes whose reply begins with a byte count."""

ECHOED = (5, 6, 15, 16)
"""Function codes whose reply repeats the request."""


class Framing(Protocol):
    """Where a frame ends, and what in it is function code and data.

    Attributes
    ----------
    trailer : int
        Bytes of the checksum behind them.
    """

    trailer: int

    def split(self, buffer: bytearray) -> list[bytes]:
        """Take whole frames off the front of `buffer`."""
        ...

    def unit(self, frame: bytes) -> bytes:
        """Return function code and data of a frame."""
        ...

    def rebuild(self, frame: bytes, unit: bytes) -> bytes:
        """Return `frame` with other function code and data, length and checksum made to fit."""
        ...

    def with_address(self, frame: bytes) -> bytes:
        """Return `frame` from another device, checksum made to fit."""
        ...


class TcpFraming:
    """Modbus TCP: a header of number, protocol, length and unit."""

    trailer = 0

    def split(self, buffer: bytearray) -> list[bytes]:
        """Take whole frames off the front of `buffer`."""
        frames: list[bytes] = []
        while len(buffer) >= _HEADER.size:
            end = 6 + struct.unpack_from(">H", buffer, 4)[0]
            if len(buffer) < end:
                break
            frames.append(bytes(buffer[:end]))
            del buffer[:end]
        return frames

    def unit(self, frame: bytes) -> bytes:
        """Return function code and data of a frame."""
        return frame[_HEADER.size :]

    def rebuild(self, frame: bytes, unit: bytes) -> bytes:
        """Return `frame` with other function code and data."""
        return frame[:4] + struct.pack(">H", len(unit) + 1) + frame[6:7] + unit

    def with_address(self, frame: bytes) -> bytes:
        """Return `frame` from another device."""
        return frame[:6] + bytes((frame[6] ^ 0x55,)) + frame[7:]


class RtuFraming:
    """Modbus RTU replies: address, function code, data, checksum.

    Parameters
    ----------
    crc : callable
        Checksum of bytes, as it stands on the wire.
    """

    trailer = 2

    def __init__(self, crc: Callable[[bytes], bytes]) -> None:
        self._crc = crc

    def split(self, buffer: bytearray) -> list[bytes]:
        """Take whole replies off the front of `buffer`; what is none of them passes as it is."""
        frames: list[bytes] = []
        while len(buffer) >= 3:
            function = buffer[1]
            size = 8 if function in ECHOED else 5 + buffer[2] if function in COUNTED else 5
            if len(buffer) < size:
                break
            frames.append(bytes(buffer[:size]))
            del buffer[:size]
        return frames

    def unit(self, frame: bytes) -> bytes:
        """Return function code and data of a frame."""
        return frame[1:-2]

    def rebuild(self, frame: bytes, unit: bytes) -> bytes:
        """Return `frame` with other function code and data."""
        body = frame[:1] + unit
        return body + self._crc(body)

    def with_address(self, frame: bytes) -> bytes:
        """Return `frame` from another device."""
        body = bytes((frame[0] ^ 0x55,)) + frame[1:-2]
        return body + self._crc(body)


class RawFraming:
    """Bytes without frames: each read counts as one."""

    trailer = 0

    def split(self, buffer: bytearray) -> list[bytes]:
        """Take everything."""
        data = bytes(buffer)
        buffer.clear()
        return [data] if data else []

    def unit(self, frame: bytes) -> bytes:
        """Return all bytes."""
        return frame

    def rebuild(self, frame: bytes, unit: bytes) -> bytes:
        """Return the other bytes."""
        return unit

    def with_address(self, frame: bytes) -> bytes:
        """Return the bytes as they are: nothing names their sender."""
        return frame
