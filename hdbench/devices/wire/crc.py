"""The checksum of Modbus RTU."""

from __future__ import annotations

import struct
from array import array

__all__ = ["CRC_START", "crc16", "crc_over"]


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


CRC_START = 0xFFFF
"""The remainder before the first character."""


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
