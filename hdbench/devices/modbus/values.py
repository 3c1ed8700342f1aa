"""Values in registers: type, order of bytes and words."""

from __future__ import annotations

import math
import struct
from typing import Literal

__all__ = ["Order", "Type", "decode", "encode", "range_of", "size_of"]

Type = Literal["i16", "u16", "i32", "u32", "f32", "f64"]
Order = Literal["ABCD", "CDAB", "BADC", "DCBA"]

_FORMATS: dict[str, str] = {
    "i16": ">h", "u16": ">H", "i32": ">i", "u32": ">I", "f32": ">f", "f64": ">d",
}  # fmt: skip


def size_of(kind: Type) -> int:
    """Return how many registers a value of a type takes."""
    return struct.calcsize(_FORMATS[kind]) // 2


def range_of(kind: Type) -> tuple[float, float]:
    """Return the ends of a type; those of a float are infinite."""
    bits = 16 * size_of(kind)
    if kind.startswith("i"):
        return -(2.0 ** (bits - 1)), 2.0 ** (bits - 1) - 1.0
    return (0.0, 2.0**bits - 1.0) if kind.startswith("u") else (-math.inf, math.inf)


def decode(raw: bytes, kind: Type, order: Order) -> float | int:
    """Return the value of registers."""
    value: float | int = struct.unpack(_FORMATS[kind], _ordered(raw, order))[0]
    return value


def encode(value: float, kind: Type, order: Order) -> bytes:
    """Return the registers of a value; whole-number types take the nearest."""
    low, high = range_of(kind)
    # written so that NaN fails
    if not (math.isfinite(value) and low - 0.5 <= value <= high + 0.5):
        raise ValueError(f"{value!r} does not fit {kind}: {low:g} to {high:g}")
    number = value if kind.startswith("f") else min(max(round(value), int(low)), int(high))
    try:
        return _ordered(struct.pack(_FORMATS[kind], number), order)
    except OverflowError as error:
        raise ValueError(f"{value!r} does not fit {kind}") from error


def _ordered(raw: bytes, order: Order) -> bytes:
    """Return the bytes in another order; the same again gives them back."""
    words = [raw[at : at + 2] for at in range(0, len(raw), 2)]
    if order in ("CDAB", "DCBA"):
        words.reverse()
    if order in ("BADC", "DCBA"):
        words = [word[::-1] for word in words]
    return b"".join(words)
