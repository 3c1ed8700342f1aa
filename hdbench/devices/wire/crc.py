"""The checksum of Modbus RTU."""

from __future__ import annotations

__all__ = ["crc16"]


def _table() -> tuple[int, ...]:
    """Return the remainders of all bytes for the polynomial 0xA001 (0x8005, bits reversed)."""
    table = []
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
        table.append(value)
    return tuple(table)


_TABLE = _table()


def crc16(data: bytes) -> bytes:
    """Return the CRC-16 of a frame as it stands on the wire, low byte first.

    Parameters
    ----------
    data : bytes
        Unit identifier, function code and data.

    Returns
    -------
    bytes
        Two bytes.

    Notes
    -----
    "MODBUS over Serial Line Specification and Implementation Guide V1.02", section 6.2.2:
    polynomial 0xA001, start value 0xFFFF.
    """
    value = 0xFFFF
    table = _TABLE
    for byte in data:
        value = value >> 8 ^ table[(value ^ byte) & 0xFF]
    return value.to_bytes(2, "little")
