"""Where values stand on the wire, and which requests read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from hdbench.devices.modbus.values import Order, Type, decode, size_of
from hdbench.devices.wire import Request, read_bits, read_registers
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusPlace
from hdbench.profile.modbus_checks import number_ranges

__all__ = ["Block", "Place", "place_of", "plan_blocks", "values_of"]

Space = Literal["holding", "input", "coil", "discrete"]
_REGISTER_READS = {"holding": 3, "input": 4}
_BIT_READS = {"coil": 1, "discrete": 2}
_MAX_BITS = 2000


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
