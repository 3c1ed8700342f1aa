"""What a reply must look like, byte for byte; pymodbus accepts far more."""

from __future__ import annotations

import struct
from collections.abc import Callable

__all__ = [
    "EXCEPTIONS",
    "ExceptionReply",
    "FrameError",
    "ReplyCheck",
    "echo_check",
    "find_reply",
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
_HEADER = struct.Struct(">HHHB")


class FrameError(Exception):
    """A reply that must not be delivered."""


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


def find_reply(data: bytes, tid: int, unit: int) -> bytes | None:
    """Return the PDU in `data` that answers transaction `tid` of `unit`; None while incomplete.

    Parameters
    ----------
    data : bytes
        Everything received and not yet consumed, frame boundaries first.
    tid, unit : int
        Transaction and unit identifier of the request.

    Returns
    -------
    bytes or None
        Function code and data. Whole frames of other transactions or units are skipped.

    Raises
    ------
    FrameError
        If the stream is not Modbus TCP.
    """
    position = 0
    while len(data) - position >= _HEADER.size:
        frame_tid, protocol, length, frame_unit = _HEADER.unpack_from(data, position)
        # unit and function code at least, 253 bytes of PDU at most
        if protocol != 0 or not 2 <= length <= 254:
            raise FrameError(f"protocol {protocol}, length {length}: not a Modbus TCP frame")
        end = position + 6 + length
        if len(data) < end:
            return None
        if (frame_tid, frame_unit) == (tid, unit):
            return data[position + 7 : end]
        position = end
    return None


def _check_function(pdu: bytes, function: int) -> None:
    if pdu[0] == function | 0x80 and len(pdu) == 2:
        raise ExceptionReply(pdu[1])
    if pdu[0] != function:
        raise FrameError(f"function code {pdu[0]}; needed: {function}")


def registers_check(function: int, count: int) -> ReplyCheck:
    """Return a check of a reply that must carry exactly `count` registers.

    Parameters
    ----------
    function : int
        Function code of the request.
    count : int
        Registers asked for, 1 to 125.

    Returns
    -------
    callable
        Raises `FrameError` on any other reply, `ExceptionReply` on a refusal.
    """

    def check(pdu: bytes) -> None:
        _check_function(pdu, function)
        if len(pdu) != 2 + 2 * count or pdu[1] != 2 * count:
            named = pdu[1] if len(pdu) > 1 else None
            raise FrameError(
                f"byte count {named} with {len(pdu) - 2} bytes of data; needed: {2 * count}"
            )

    return check


def echo_check(function: int, address: int, second: int) -> ReplyCheck:
    """Return a check of a reply that must repeat a write.

    Parameters
    ----------
    function : int
        Function code of the request.
    address : int
        First register.
    second : int
        The value (FC6) or the number of registers (FC16).

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
