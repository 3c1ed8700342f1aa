"""What a reply must look like, byte for byte."""

from __future__ import annotations

import struct
from collections.abc import Callable

__all__ = [
    "EXCEPTIONS",
    "ExceptionReply",
    "FrameError",
    "ReplyCheck",
    "StaleReply",
    "bits_check",
    "echo_check",
    "registers_check",
]

EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledged, still working",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target does not respond",
}
ReplyCheck = Callable[[bytes], None]
"""Raises on a reply (function code and data) that the request does not allow."""


class FrameError(Exception):
    """A reply that must not be delivered, or none at all."""


class StaleReply(Exception):  # noqa: N818 - a good reply, but to another request
    """A reply that belongs to an earlier request: it is dropped, and the wait goes on."""


class ExceptionReply(Exception):  # noqa: N818 - a well-formed answer, not a fault of the wire
    """The device refused the request.

    Parameters
    ----------
    code : int
        Modbus exception code.
    """

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code} ({EXCEPTIONS.get(code, 'unknown')})")
        self.code = code


def _check_function(pdu: bytes, function: int) -> None:
    if len(pdu) == 2 and pdu[0] == function | 0x80:
        raise ExceptionReply(pdu[1])
    if not pdu or pdu[0] != function:
        raise FrameError(f"function code {pdu[0] if pdu else 'missing'}; needed: {function}")


def registers_check(function: int, count: int) -> ReplyCheck:
    """Return a check of a reply that must carry exactly `count` registers.

    Parameters
    ----------
    function : int
        Function code of the request: 3, 4 or 23.
    count : int
        Registers asked for, 1 to 125.

    Returns
    -------
    callable
        Raises `FrameError` on any other reply, `ExceptionReply` on a refusal.
    """
    head = bytes((function, 2 * count))
    size = 2 + 2 * count

    def check(pdu: bytes) -> None:
        if len(pdu) == size and pdu.startswith(head):
            return
        _check_function(pdu, function)
        named = pdu[1] if len(pdu) > 1 else None
        raise FrameError(
            f"byte count {named} with {len(pdu) - 2} bytes of data; needed: {size - 2}"
        )

    return check


def bits_check(function: int, count: int) -> ReplyCheck:
    """Return a check of a reply that must carry exactly `count` bits, the unused ones zero.

    Parameters
    ----------
    function : int
        Function code of the request: 1 or 2.
    count : int
        Bits asked for, 1 to 2000.

    Returns
    -------
    callable
        Raises `FrameError` on any other reply, `ExceptionReply` on a refusal.
    """
    n_bytes = (count + 7) // 8

    def check(pdu: bytes) -> None:
        _check_function(pdu, function)
        if len(pdu) != 2 + n_bytes or pdu[1] != n_bytes:
            raise FrameError(f"{len(pdu) - 2} bytes of data; needed: {n_bytes}")
        if count % 8 and pdu[-1] >> (count % 8):
            raise FrameError("bits beyond those asked for are not zero")

    return check


def echo_check(function: int, address: int, second: int) -> ReplyCheck:
    """Return a check of a reply that must repeat a write.

    Parameters
    ----------
    function : int
        Function code of the request: 5, 6, 15 or 16.
    address : int
        First register or coil.
    second : int
        The value (FC5, FC6) or the number of registers or coils (FC15, FC16).

    Returns
    -------
    callable
        Raises `FrameError` on any other reply, `ExceptionReply` on a refusal.
    """
    expected = struct.pack(">BHH", function, address, second)

    def check(pdu: bytes) -> None:
        _check_function(pdu, function)
        if pdu != expected:
            raise FrameError(f"echo {pdu.hex(' ')}; needed: {expected.hex(' ')}")

    return check
