"""Registers of devices: named values on the wire, their types, and their bytes."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from hdbench.devices.daq import clean_text

Space = Literal["coil", "discrete", "holding", "input"]
"""A table of a Modbus device."""

Kind = Literal["u16", "i16", "u32", "i32", "f32", "f64", "text", "scans"]
"""Type of a value; ``text`` has 16 bytes, ``scans`` fill the block of a node."""

Order = Literal["ABCD", "CDAB", "BADC", "DCBA"]
"""Order of the bytes of a number; ABCD begins with the most significant one."""

Value = int | float | str

BLOCK_DATA_REGISTERS = 113  # a reply carries at most 125 registers, 12 of them the block's header
FORMATS: Mapping[str, str] = {
    "u16": ">H", "i16": ">h", "u32": ">I", "i32": ">i", "f32": ">f", "f64": ">d",
}  # fmt: skip
_SIZES: Mapping[str, int] = {
    "u16": 1, "i16": 1, "u32": 2, "i32": 2, "f32": 2, "f64": 4,
    "text": 8, "scans": BLOCK_DATA_REGISTERS,
}  # fmt: skip


def size_of(kind: Kind) -> int:
    """Return how many registers a value of a type takes."""
    return _SIZES[kind]


def range_of(kind: Kind) -> tuple[float, float]:
    """Return the ends of a type; those of a float are infinite."""
    bits = 16 * size_of(kind)
    if kind.startswith("i"):
        return -(2.0 ** (bits - 1)), 2.0 ** (bits - 1) - 1.0
    return (0.0, 2.0**bits - 1.0) if kind.startswith("u") else (-math.inf, math.inf)


def decode(raw: bytes, kind: Kind, order: Order = "ABCD") -> float | int:
    """Return the number in registers."""
    value: float | int = struct.unpack(FORMATS[kind], ordered(raw, order))[0]
    return value


def encode(value: float, kind: Kind, order: Order = "ABCD") -> bytes:
    """Return the registers of a number; whole-number types take the nearest."""
    low, high = range_of(kind)
    # written so that NaN fails
    if not (math.isfinite(value) and low - 0.5 <= value <= high + 0.5):
        raise ValueError(f"{value!r} does not fit {kind}: {low:g} to {high:g}")
    number = value if kind.startswith("f") else min(max(round(value), int(low)), int(high))
    try:
        return ordered(struct.pack(FORMATS[kind], number), order)
    except OverflowError as error:
        raise ValueError(f"{value!r} does not fit {kind}") from error


def ordered(raw: bytes, order: Order) -> bytes:
    """Return the bytes in another order; the same again gives them back."""
    if order == "ABCD":
        return raw
    words = [raw[at : at + 2] for at in range(0, len(raw), 2)]
    if order in ("CDAB", "DCBA"):
        words.reverse()
    if order in ("BADC", "DCBA"):
        words = [word[::-1] for word in words]
    return b"".join(words)


def as_float32(value: float) -> float:
    """Return `value` as the nearest 32-bit float, the form in which a device keeps it."""
    return float(struct.unpack(">f", struct.pack(">f", value))[0])


@dataclass(frozen=True, slots=True)
class Register:
    """One value of a device.

    Parameters
    ----------
    name : str
        As its maker or the profile calls it, for messages.
    address : int
        First register or bit, counted from 0.
    kind : str
        Type of the value.
    writable : bool
        Whether hdbench may write it by name.
    meaning : str
        One line.
    space : str
        Table.
    order : str
        Order of the bytes on the wire.
    """

    name: str
    address: int
    kind: Kind
    writable: bool = False
    meaning: str = ""
    space: Space = "holding"
    order: Order = "ABCD"

    @property
    def is_bit(self) -> bool:
        """Whether it is a coil or a discrete input."""
        return self.space in ("coil", "discrete")

    @property
    def size(self) -> int:
        """Registers, or 1 for a bit."""
        return 1 if self.is_bit else _SIZES[self.kind]

    def encode(self, value: Value) -> bytes:
        """Return the registers of `value`; raises `ValueError` where they do not hold it."""
        if isinstance(value, str):
            return value.encode()[:16].ljust(16, b"\0")
        try:
            if self.kind in ("f32", "f64"):
                # a device may hold any float
                return ordered(struct.pack(FORMATS[self.kind], value), self.order)
            return encode(value, self.kind, self.order)
        except (ValueError, OverflowError) as error:
            raise ValueError(f"{self.name}: {error}") from error

    def decode(self, raw: bytes) -> Value:
        """Return the value of exactly `size` registers."""
        return clean_text(raw) if self.kind == "text" else decode(raw, self.kind, self.order)

    def describe(self) -> str:
        """Return name and address as messages show them."""
        return f"{self.name} ({self.address})"


def encode_group(group: Sequence[Register], values: Mapping[str, Value]) -> bytes:
    """Return the bytes of `group`, one value for each of its names."""
    return b"".join(entry.encode(values[entry.name]) for entry in group)


def decode_group(group: Sequence[Register], raw: bytes) -> dict[str, Value]:
    """Return the values of adjacent registers from their bytes."""
    start = group[0].address
    return {
        entry.name: entry.decode(
            raw[2 * (entry.address - start) : 2 * (entry.address - start + entry.size)]
        )
        for entry in group
    }
