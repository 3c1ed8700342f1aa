"""Where a frame of Modbus RTU ends: told by its function code, as it comes."""

from __future__ import annotations

from hdbench.devices.wire.checks import FrameError

__all__ = ["reply_size"]

# frame lengths: replies with a byte count of their own, and those of a fixed length
_COUNTED = frozenset((1, 2, 3, 4, 23))
_ECHOED = frozenset((5, 6, 15, 16))
_ECHO_SIZE = 8
_EXCEPTION_SIZE = 5


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
