"""Values to registers and back: big-endian, most significant word first."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence

import numpy as np

from hdbench.devices.node.registers import Register
from hdbench.devices.text import clean_text

__all__ = ["Value", "as_float32", "decode_group", "encode_group"]

Value = int | float | str
_FORMATS = {"u16": ">H", "i16": ">h", "u32": ">I", "i32": ">i", "f32": ">f"}


def as_float32(value: float) -> float:
    """Return `value` as the nearest 32-bit float, the form in which the node keeps it."""
    return float(np.float32(value))


def _encode(entry: Register, value: Value) -> bytes:
    if entry.kind == "text":
        return str(value).encode()[:16].ljust(16, b"\0")
    return struct.pack(_FORMATS[entry.kind], value)


def _decode(entry: Register, raw: bytes) -> Value:
    if entry.kind == "text":
        return clean_text(raw)
    value: int | float = struct.unpack(_FORMATS[entry.kind], raw)[0]
    return value


def encode_group(group: Sequence[Register], values: Mapping[str, Value]) -> bytes:
    """Return the bytes of `group`, one value for each of its names."""
    return b"".join(_encode(entry, values[entry.name]) for entry in group)


def decode_group(group: Sequence[Register], raw: bytes) -> dict[str, Value]:
    """Return the values of `group` from the bytes of its registers."""
    start = group[0].address
    return {
        entry.name: _decode(
            entry, raw[2 * (entry.address - start) : 2 * (entry.address - start + entry.size)]
        )
        for entry in group
    }
