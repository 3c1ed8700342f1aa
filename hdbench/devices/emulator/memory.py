"""Memory of an emulated Modbus device: registers and bits, and what their access does."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

from hdbench.devices.emulator.server import ModbusRefusedError, Space
from hdbench.devices.modbus.layout import Place, decode, encode, range_of

ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE = 2, 3, 4
_MAX_REGISTERS = 125


@dataclass(slots=True)
class Cell:
    """One value.

    Parameters
    ----------
    place : Place
        Where it stands.
    value : float
        What it holds.
    on_read : callable, optional
        Gives the value in place of `value`.
    on_write : callable, optional
        Takes what was written; may raise `ModbusRefusedError`, and then nothing is kept.
    writable : bool
        Whether a host may write it.
    """

    place: Place
    value: float = 0.0
    on_read: Callable[[], float] | None = None
    on_write: Callable[[float], None] | None = None
    writable: bool = True

    def words(self, *, swap: bool) -> list[int]:
        """Return its registers, or its bit."""
        value = self.value if self.on_read is None else self.on_read()
        if self.place.is_bit:
            return [int(bool(value))]
        low, high = range_of(self.place.kind)
        raw = encode(min(max(value, low), high), self.place.kind, self.place.order)
        words = list(struct.unpack(f">{len(raw) // 2}H", raw))
        return words[::-1] if swap else words


class Memory:
    """All cells of a device.

    Parameters
    ----------
    max_registers : int
        Most registers that one request may read.
    lenient : bool
        Whether registers between known ones read as 0; otherwise they are refused.

    Attributes
    ----------
    swap_words : bool
        Whether a gateway on the way swaps the words of what is read.
    """

    def __init__(self, max_registers: int = _MAX_REGISTERS, *, lenient: bool = False) -> None:
        self.max_registers = max_registers
        self.lenient = lenient
        self.swap_words = False
        self._cells: dict[tuple[str, int], Cell] = {}

    def add(self, cell: Cell) -> Cell:
        """Put a cell where its place says; one that begins at the same place is kept instead."""
        return self._cells.setdefault((cell.place.space, cell.place.start), cell)

    def read(self, space: Space, start: int, count: int) -> bytes:
        """Return registers, or bits packed from the lowest on."""
        bits = space in ("coil", "discrete")
        if not bits and count > self.max_registers:
            raise ModbusRefusedError(ILLEGAL_VALUE)
        words = self._words(space, start, count)
        if not bits:
            return struct.pack(f">{count}H", *words)
        packed = sum(bit << number for number, bit in enumerate(words))
        return packed.to_bytes((count + 7) // 8, "little")

    def write(self, space: Space, start: int, raw: bytes) -> None:
        """Write registers, or one bit as 0xFF00 or 0."""
        words = list(struct.unpack(f">{len(raw) // 2}H", raw))
        self._write(space, start, [int(words[0] != 0)] if space == "coil" else words)

    def _words(self, space: Space, start: int, count: int) -> list[int]:
        found: dict[int, int] = {}
        for cell in self._cells.values():
            place = cell.place
            if place.space != space or not place.start < start + count:
                continue
            if place.start + place.size > start:
                for number, word in enumerate(cell.words(swap=self.swap_words)):
                    found[place.start + number] = word
        wanted = range(start, start + count)
        if not found or not (self.lenient or len(found.keys() & set(wanted)) == count):
            raise ModbusRefusedError(ILLEGAL_ADDRESS)
        return [found.get(at, 0) for at in wanted]

    def _write(self, space: Space, start: int, words: list[int]) -> None:
        at = 0
        while at < len(words):
            cell = self._cells.get((space, start + at))
            if cell is None or not cell.writable or at + cell.place.size > len(words):
                raise ModbusRefusedError(ILLEGAL_ADDRESS)
            raw = struct.pack(f">{cell.place.size}H", *words[at : at + cell.place.size])
            value: float = (
                words[at] if cell.place.is_bit else decode(raw, cell.place.kind, cell.place.order)
            )
            if cell.on_write is not None:
                cell.on_write(value)
            cell.value = value
            at += cell.place.size
