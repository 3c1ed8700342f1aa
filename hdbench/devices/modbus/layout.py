"""Layout of a polled device: values in registers, their places, and the requests that read them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hdbench.devices.registers import FORMATS, Register, Space, decode, encode, ordered
from hdbench.devices.wire import link
from hdbench.profile.acquiring_modbus import (
    ModbusAcquisition,
    ModbusIdentify,
    ModbusPlace,
    number_ranges,
)

# 32-bit floats carry a decimal number to 6e-8 of itself
_ROUNDING = 1e-6
_REGISTER_READS = {"holding": 3, "input": 4}
_BIT_READS = {"coil": 1, "discrete": 2}
_MAX_BITS = 2000


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

    def request(self) -> link.Request:
        """Return the read and the check of its reply."""
        if self.space in _BIT_READS:
            return link.read_bits(self.start, self.size, function=_BIT_READS[self.space])
        return link.read_registers(self.start, self.size, function=_REGISTER_READS[self.space])

    @property
    def reply_bytes(self) -> int:
        """Bytes of data in the reply."""
        return (self.size + 7) // 8 if self.space in _BIT_READS else 2 * self.size

    def holds(self, place: Register) -> bool:
        """Whether a value lies wholly in it."""
        end = self.start + self.size
        inside = self.start <= place.address and place.address + place.size <= end
        return place.space == self.space and inside


def place_of(table: ModbusAcquisition, place: ModbusPlace) -> Register:
    """Return a place of the profile as it is on the wire."""
    ranges = number_ranges(table.numbering, place.table)
    first = next((low for low, high in ranges if low <= place.address <= high), ranges[0][0])
    name = f"{place.table} {place.address}"
    return Register(name, place.address - first, place.type, space=place.table, order=place.order)


def write_request(place: Register, value: float, function: int | None = None) -> link.Request:
    """Return a write of one value; raises `ValueError` where its type does not hold it."""
    if place.is_bit:
        return link.write_bit(place.address, on=bool(value))
    raw = encode(value, place.kind, place.order)
    if function == 6 or (function is None and place.size == 1):
        return link.write_register(place.address, int.from_bytes(raw, "big"))
    return link.write_registers(place.address, raw)


def form_of(place: Register) -> tuple[str, tuple[int, ...]]:
    """Return form and order of the bytes of a value as the guard reads them."""
    return FORMATS[place.kind], tuple(ordered(bytes(range(2 * place.size)), place.order))


def blocks_of(table: ModbusAcquisition, places: Sequence[Register]) -> tuple[Block, ...]:
    """Return the reads of a device that hold all places."""
    most, bridge = table.max_read_registers, table.bridge_registers
    return plan_blocks(places, most=most, bridge=bridge)


def plan_blocks(places: Sequence[Register], *, most: int, bridge: int) -> tuple[Block, ...]:
    """Return the fewest reads of adjacent registers that hold all places."""
    blocks: list[Block] = []
    for place in sorted(places, key=lambda each: (each.space, each.address, -each.size)):
        limit = _MAX_BITS if place.is_bit else most
        last = blocks[-1] if blocks else None
        if last is not None and last.space == place.space:
            end = max(last.start + last.size, place.address + place.size)
            near = place.address - (last.start + last.size) <= bridge
            if near and end - last.start <= limit:
                blocks[-1] = Block(last.space, last.start, end - last.start, last.name)
                continue
        blocks.append(Block(place.space, place.address, place.size, place.name))
    return tuple(blocks)


def values_of(places: Sequence[Register], replies: Mapping[Block, bytes]) -> list[float | int]:
    """Return the values of places from the data of the reads that hold them."""
    values: list[float | int] = []
    for place in places:
        block = next(each for each in replies if each.holds(place))
        at, data = place.address - block.start, replies[block]
        if place.is_bit:
            values.append(data[at // 8] >> at % 8 & 1)
        else:
            raw = data[2 * at : 2 * (at + place.size)]
            values.append(decode(raw, place.kind, place.order))
    return values
