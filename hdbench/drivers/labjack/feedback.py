"""Function 76, "Modbus Feedback": several writes and reads at any addresses in one transaction."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from hdbench.devices.wire import ReplyForm, Request
from hdbench.drivers.labjack.registers import Register

__all__ = ["FUNCTION", "Write", "feedback_request"]

FUNCTION = 76
_READ, _WRITE = 0, 1
# a request or reply of the usual size: 253 bytes of function code and data
_MAX_PDU = 253

Write = tuple[Register, float]


def feedback_request(writes: Sequence[Write], reads: Sequence[Register]) -> Request:
    """Return a request that writes first and reads afterwards, with the check of its reply.

    Notes
    -----
    Frame: kind (1 byte: 0 read, 1 write), address (2), number of registers (1), and for a write
    the values; the reply carries the values read and nothing else (LabJack, "Protocol details,
    direct Modbus TCP"). The reply has no byte count: its length is compared with what was asked.
    """
    closed = [register.name for register, _ in writes if not register.writable]
    if closed:
        raise ValueError(f"not written by this driver: {', '.join(closed)}")
    frames = [
        struct.pack(">BHB", _WRITE, register.address, register.size) + register.encode(value)
        for register, value in writes
    ]
    frames += [struct.pack(">BHB", _READ, register.address, register.size) for register in reads]
    request = bytes((FUNCTION,)) + b"".join(frames)
    size = 1 + 2 * sum(register.size for register in reads)
    if max(len(request), size) > _MAX_PDU:
        raise ValueError(f"{max(len(request), size)} bytes; a frame holds {_MAX_PDU}")

    return request, ReplyForm(bytes((FUNCTION,)), size)
