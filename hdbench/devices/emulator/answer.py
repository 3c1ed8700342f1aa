"""One Modbus request to one reply: function codes 3, 6, 16 and 23."""

from __future__ import annotations

import struct
from typing import Protocol

from hdbench.devices.emulator.parameters import RefusedError
from hdbench.devices.node.registers import Refusal

__all__ = ["Registers", "answer"]

# the specification's limits of one request
_MAX_READ = 125
_MAX_WRITE = 123
_MAX_EXCHANGE_WRITE = 121


class Registers(Protocol):
    """Register access of one node."""

    def read(self, address: int, count: int, connection: int) -> bytes:
        """Return the bytes of registers."""
        ...

    def write(self, address: int, raw: bytes, connection: int) -> None:
        """Write registers."""
        ...

    def note_refusal(self, refused: RefusedError, connection: int) -> None:
        """Keep the reason of a refusal."""
        ...


def answer(pdu: bytes, registers: Registers, connection: int) -> bytes:
    """Return the reply to one request.

    Parameters
    ----------
    pdu : bytes
        Function code and data.
    registers : Registers
        The node.
    connection : int
        Number of the connection.

    Returns
    -------
    bytes
        Function code and data, or the exception reply.
    """
    try:
        return _carry_out(pdu, registers, connection)
    except RefusedError as refused:
        registers.note_refusal(refused, connection)
        return bytes((pdu[0] | 0x80, refused.exception))
    except struct.error:
        # shorter than its function code asks for
        return bytes((pdu[0] | 0x80, 3))


def _carry_out(pdu: bytes, registers: Registers, connection: int) -> bytes:
    function = pdu[0]
    if function == 3:
        address, count = struct.unpack(">HH", pdu[1:])
        return _read(function, address, count, registers, connection)
    if function == 6:
        (address,) = struct.unpack(">H", pdu[1:3])
        _write(address, 1, pdu[3:], registers, connection)
        return pdu
    if function == 16:
        address, count, n_bytes = struct.unpack(">HHB", pdu[1:6])
        if not (1 <= count <= _MAX_WRITE and n_bytes == 2 * count):
            raise RefusedError(3, Refusal.VALUE, address)
        _write(address, count, pdu[6:], registers, connection)
        return pdu[:5]
    if function == 23:
        address, count, target, n_written, n_bytes = struct.unpack(">HHHHB", pdu[1:10])
        if not (1 <= n_written <= _MAX_EXCHANGE_WRITE and n_bytes == 2 * n_written):
            raise RefusedError(3, Refusal.VALUE, target)
        _write(target, n_written, pdu[10:], registers, connection)
        return _read(function, address, count, registers, connection)
    raise RefusedError(1, Refusal.NONE, 0)


def _read(function: int, address: int, count: int, registers: Registers, connection: int) -> bytes:
    if not 1 <= count <= _MAX_READ:
        raise RefusedError(3, Refusal.VALUE, address)
    raw = registers.read(address, count, connection)
    return bytes((function, len(raw))) + raw


def _write(address: int, count: int, raw: bytes, registers: Registers, connection: int) -> None:
    if len(raw) != 2 * count:
        raise RefusedError(3, Refusal.VALUE, address)
    registers.write(address, raw, connection)
