"""What a reply must look like, byte for byte."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

__all__ = [
    "EXCEPTIONS",
    "ExceptionReply",
    "FrameError",
    "ReplyCheck",
    "ReplyForm",
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


@dataclass(frozen=True, slots=True)
class ReplyForm:
    """The reply that a request allows: how it begins, how long it is.

    Parameters
    ----------
    head : bytes
        How it begins, function code first.
    size : int
        Its length, bytes.
    spare_bits : int
        Bits of the last byte, from the left, that must be zero.
    """

    head: bytes
    size: int
    spare_bits: int = 0

    def __call__(self, pdu: bytes) -> None:
        """Raise `FrameError` on any other reply, `ExceptionReply` on a refusal."""
        if len(pdu) != self.size or not pdu.startswith(self.head):
            function = self.head[0]
            if len(pdu) == 2 and pdu[0] == function | 0x80:
                raise ExceptionReply(pdu[1])
            if not pdu or pdu[0] != function:
                found = pdu[0] if pdu else "missing"
                raise FrameError(f"function code {found}; needed: {function}")
            raise FrameError(
                f"a reply of {len(pdu)} bytes, {pdu[:8].hex(' ')}; needed: {self.size} bytes, "
                f"{self.head.hex(' ')} first"
            )
        if self.spare_bits and pdu[-1] >> (8 - self.spare_bits):
            raise FrameError("bits beyond those asked for are not zero")


def registers_check(function: int, count: int) -> ReplyForm:
    """Return the form of a reply with exactly `count` registers.

    Parameters
    ----------
    function : int
        Function code of the request: 3, 4 or 23.
    count : int
        Registers asked for, 1 to 125.

    Returns
    -------
    ReplyForm
    """
    return ReplyForm(bytes((function, 2 * count)), 2 + 2 * count)


def bits_check(function: int, count: int) -> ReplyForm:
    """Return the form of a reply with exactly `count` bits, the unused ones zero.

    Parameters
    ----------
    function : int
        Function code of the request: 1 or 2.
    count : int
        Bits asked for, 1 to 2000.

    Returns
    -------
    ReplyForm
    """
    n_bytes = (count + 7) // 8
    return ReplyForm(bytes((function, n_bytes)), 2 + n_bytes, -count % 8)


def echo_check(function: int, address: int, second: int) -> ReplyForm:
    """Return the form of a reply that repeats a write.

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
    ReplyForm
    """
    return ReplyForm(struct.pack(">BHH", function, address, second), 5)
