"""Requests as bytes, each with the check of its reply."""

from __future__ import annotations

import struct

from hdbench.devices.wire.checks import ReplyForm, bits_check, echo_check, registers_check

__all__ = [
    "Request",
    "exchange_registers",
    "read_bits",
    "read_registers",
    "write_bit",
    "write_register",
    "write_registers",
]

_MAX_READ = 125
_MAX_WRITE = 123
_MAX_EXCHANGE_WRITE = 121
_MAX_BITS = 2000
Request = tuple[bytes, ReplyForm]
"""Function code and data, and the form of the reply."""


def _bound(name: str, value: int, high: int) -> None:
    if not 1 <= value <= high:
        raise ValueError(f"{name} {value}; needed: 1 to {high}")


def read_registers(address: int, count: int, *, function: int = 3) -> Request:
    """Return a read of holding (function 3) or input registers (function 4).

    Parameters
    ----------
    address : int
        First register, from 0.
    count : int
        Registers, 1 to 125.
    function : int
        3 or 4.

    Returns
    -------
    tuple of bytes and callable
        Function code and data; the check of the reply, whose data begin at byte 2.

    Raises
    ------
    ValueError
        If `count` is outside its range.
    """
    _bound("count", count, _MAX_READ)
    return struct.pack(">BHH", function, address, count), registers_check(function, count)


def read_bits(address: int, count: int, *, function: int = 1) -> Request:
    """Return a read of coils (function 1) or discrete inputs (function 2), 1 to 2000.

    Parameters
    ----------
    address : int
        First bit, from 0.
    count : int
        Bits, 1 to 2000.
    function : int
        1 or 2.

    Returns
    -------
    tuple of bytes and callable
        Function code and data; the check of the reply.
    """
    _bound("count", count, _MAX_BITS)
    return struct.pack(">BHH", function, address, count), bits_check(function, count)


def write_register(address: int, value: int) -> Request:
    """Return a write of one register, 0 to 65535 (function 6).

    Parameters
    ----------
    address : int
        Register, from 0.
    value : int
        0 to 65535.

    Returns
    -------
    tuple of bytes and callable
        Function code and data; the check of the reply.
    """
    return struct.pack(">BHH", 6, address, value), echo_check(6, address, value)


def write_bit(address: int, *, on: bool) -> Request:
    """Return a write of one coil (function 5).

    Parameters
    ----------
    address : int
        Coil, from 0.
    on : bool
        Its state.

    Returns
    -------
    tuple of bytes and callable
        Function code and data; the check of the reply.
    """
    value = 0xFF00 if on else 0
    return struct.pack(">BHH", 5, address, value), echo_check(5, address, value)


def write_registers(address: int, values: bytes) -> Request:
    """Return a write of 1 to 123 registers, two bytes each (function 16).

    Parameters
    ----------
    address : int
        First register, from 0.
    values : bytes
        Two bytes for each register.

    Returns
    -------
    tuple of bytes and callable
        Function code and data; the check of the reply.
    """
    count = len(values) // 2
    _bound("registers", count, _MAX_WRITE)
    head = struct.pack(">BHHB", 16, address, count, len(values))
    return head + values, echo_check(16, address, count)


def exchange_registers(address: int, count: int, target: int, values: bytes) -> Request:
    """Return a write of `values` at `target`, then a read of `count` registers (function 23).

    Parameters
    ----------
    address : int
        First register to read, from 0.
    count : int
        Registers to read, 1 to 125.
    target : int
        First register to write, from 0.
    values : bytes
        Two bytes for each register, 1 to 121 registers.

    Returns
    -------
    tuple of bytes and callable
        Function code and data; the check of the reply.
    """
    _bound("count", count, _MAX_READ)
    n_written = len(values) // 2
    _bound("registers", n_written, _MAX_EXCHANGE_WRITE)
    head = struct.pack(">BHHHHB", 23, address, count, target, n_written, len(values))
    return head + values, registers_check(23, count)
