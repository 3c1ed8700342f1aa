"""Layout of a polled device: values in registers, their places, and the requests that read them."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from hdbench.devices.wire import (
    Request,
    read_bits,
    read_registers,
    write_bit,
    write_register,
    write_registers,
)
from hdbench.profile.acquiring_modbus import (
    ModbusAcquisition,
    ModbusIdentify,
    ModbusPlace,
    number_ranges,
)

Type = Literal["i16", "u16", "i32", "u32", "f32", "f64"]
Order = Literal["ABCD", "CDAB", "BADC", "DCBA"]

_FORMATS: dict[str, str] = {
    "i16": ">h", "u16": ">H", "i32": ">i", "u32": ">I", "f32": ">f", "f64": ">d",
}  # fmt: skip
# 32-bit floats carry a decimal number to 6e-8 of itself
_ROUNDING = 1e-6
Space = Literal["holding", "input", "coil", "discrete"]
_REGISTER_READS = {"holding": 3, "input": 4}
_BIT_READS = {"coil": 1, "discrete": 2}
_MAX_BITS = 2000


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


def bounds(rule: ModbusIdentify) -> tuple[float, float]:
    """Return between which values a rule is kept."""
    low = -math.inf if rule.low is None else rule.low
    high = math.inf if rule.high is None else rule.high
    if rule.equals is not None:
        rounding = _ROUNDING * abs(rule.equals)
        low, high = max(low, rule.equals - rounding), min(high, rule.equals + rounding)
    return low, high


def fits(rule: ModbusIdentify, found: float | int) -> bool:
    """Return whether a value keeps a rule."""
    if not math.isfinite(found):
        return False
    low, high = bounds(rule)
    return low <= (int(found) & rule.mask if rule.mask is not None else found) <= high


def needed(rule: ModbusIdentify) -> str:
    """Return a rule in words."""
    words = [] if rule.equals is None else [f"{rule.equals:.9g}"]
    if rule.low is not None or rule.high is not None:
        low = "anything" if rule.low is None else f"{rule.low:.9g}"
        high = "anything" if rule.high is None else f"{rule.high:.9g}"
        words.append(f"{low} to {high}")
    masked = "" if rule.mask is None else f" in the bits 0x{rule.mask:X}"
    return " and ".join(words) + masked


@dataclass(frozen=True, slots=True)
class Place:
    """One value on the wire.

    Parameters
    ----------
    space : {"holding", "input", "coil", "discrete"}
        Table.
    start : int
        First register or bit, from 0.
    kind : {"i16", "u16", "i32", "u32", "f32", "f64"}
        Type.
    order : {"ABCD", "CDAB", "BADC", "DCBA"}
        Order of the bytes on the wire.
    name : str
        As the profile numbers it, for messages.
    """

    space: Space
    start: int
    kind: Type
    order: Order
    name: str

    @property
    def is_bit(self) -> bool:
        """Whether it is a coil or a discrete input."""
        return self.space in _BIT_READS

    @property
    def size(self) -> int:
        """Registers, or 1 for a bit."""
        return 1 if self.is_bit else size_of(self.kind)


@dataclass(frozen=True, slots=True)
class Block:
    """Adjacent registers or bits that one request reads.

    Parameters
    ----------
    space : {"holding", "input", "coil", "discrete"}
        Table.
    start, size : int
        First one, from 0, and how many.
    name : str
        First value in it, for messages.
    """

    space: Space
    start: int
    size: int
    name: str

    def request(self) -> Request:
        """Return the read and the check of its reply."""
        if self.space in _BIT_READS:
            return read_bits(self.start, self.size, function=_BIT_READS[self.space])
        return read_registers(self.start, self.size, function=_REGISTER_READS[self.space])

    @property
    def reply_bytes(self) -> int:
        """Bytes of data in the reply."""
        return (self.size + 7) // 8 if self.space in _BIT_READS else 2 * self.size

    def holds(self, place: Place) -> bool:
        """Whether a value lies wholly in it."""
        inside = self.start <= place.start and place.start + place.size <= self.start + self.size
        return place.space == self.space and inside


def place_of(table: ModbusAcquisition, place: ModbusPlace) -> Place:
    """Return a place of the profile as it is on the wire."""
    ranges = number_ranges(table.numbering, place.table)
    first = next((low for low, high in ranges if low <= place.address <= high), ranges[0][0])
    name = f"{place.table} {place.address}"
    return Place(place.table, place.address - first, place.type, place.order, name)


def write_request(place: Place, value: float, function: int | None = None) -> Request:
    """Return a write of one value; raises `ValueError` where its type does not hold it."""
    if place.is_bit:
        return write_bit(place.start, on=bool(value))
    raw = encode(value, place.kind, place.order)
    if function == 6 or (function is None and place.size == 1):
        return write_register(place.start, int.from_bytes(raw, "big"))
    return write_registers(place.start, raw)


def form_of(place: Place) -> tuple[str, tuple[int, ...]]:
    """Return form and order of the bytes of a value as the guard reads them."""
    return _FORMATS[place.kind], tuple(_ordered(bytes(range(2 * place.size)), place.order))


def plan_blocks(places: Sequence[Place], *, most: int, bridge: int) -> tuple[Block, ...]:
    """Return the fewest reads of adjacent registers that hold all places."""
    blocks: list[Block] = []
    for place in sorted(places, key=lambda each: (each.space, each.start, -each.size)):
        limit = _MAX_BITS if place.is_bit else most
        last = blocks[-1] if blocks else None
        if last is not None and last.space == place.space:
            end = max(last.start + last.size, place.start + place.size)
            near = place.start - (last.start + last.size) <= bridge
            if near and end - last.start <= limit:
                blocks[-1] = Block(last.space, last.start, end - last.start, last.name)
                continue
        blocks.append(Block(place.space, place.start, place.size, place.name))
    return tuple(blocks)


def values_of(places: Sequence[Place], replies: Mapping[Block, bytes]) -> list[float | int]:
    """Return the values of places from the data of the reads that hold them."""
    return [_value(place, replies) for place in places]


def _value(place: Place, replies: Mapping[Block, bytes]) -> float | int:
    block = next(each for each in replies if each.holds(place))
    at, data = place.start - block.start, replies[block]
    if place.is_bit:
        return data[at // 8] >> at % 8 & 1
    return decode(data[2 * at : 2 * (at + place.size)], place.kind, place.order)
