"""Memory of an emulated device: registers and bits, and what their access does."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from hdbench.devices.emulator.server import Device, ModbusRefusedError
from hdbench.devices.registers import Kind, Register, Space, decode, range_of

ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE = 2, 3, 4
_MAX_REGISTERS = 125
# registers of the longest number
_LONGEST = 4


@dataclass(slots=True)
class Cell:
    """One value.

    Parameters
    ----------
    place : Register
        Where it stands.
    value : float
        What it holds.
    on_read : callable, optional
        Gives the value in place of `value`.
    on_write : callable, optional
        Takes what was written; may raise `ModbusRefusedError`, and then nothing is kept.
    readable, writable : bool
        Whether a host may read and write it.
    """

    place: Register
    value: float = 0.0
    on_read: Callable[[], float] | None = None
    on_write: Callable[[float], None] | None = None
    readable: bool = True
    writable: bool = True

    def words(self) -> list[int]:
        """Return its registers, or its bit."""
        value = self.value if self.on_read is None else self.on_read()
        if self.place.is_bit:
            return [int(bool(value))]
        low, high = range_of(self.place.kind)
        raw = self.place.encode(min(max(value, low), high))
        return list(struct.unpack(f">{len(raw) // 2}H", raw))

    def write(self, words: list[int]) -> None:
        """Act on what was written, and keep it."""
        place = self.place
        value: float = words[0]
        if not place.is_bit:
            value = decode(struct.pack(f">{place.size}H", *words), place.kind, place.order)
        if self.on_write is not None:
            self.on_write(value)
        self.value = value


class Memory:
    """All cells of a device.

    Parameters
    ----------
    max_registers : int
        Most registers that one request may read.
    lenient : bool
        Whether registers between known ones read as 0; otherwise they are refused.
    whole : bool
        Whether part of a value is refused.
    """

    def __init__(
        self, max_registers: int = _MAX_REGISTERS, *, lenient: bool = False, whole: bool = False
    ) -> None:
        self.max_registers = max_registers
        self.lenient = lenient
        self.whole = whole
        self._cells: dict[tuple[Space, int], Cell] = {}

    def add(self, cell: Cell) -> Cell:
        """Put a cell where its place says; one that begins at the same place is kept instead."""
        return self._cells.setdefault((cell.place.space, cell.place.address), cell)

    def hold(self, address: int, kind: Kind, value: float = 0, **access: Any) -> Cell:
        """Add a holding register; `access` is the rest of `Cell`."""
        return self.add(Cell(Register("", address, kind), value, **access))

    def value(self, address: int) -> float:
        """Return what a holding register holds."""
        return self._cells["holding", address].value

    def put(self, address: int, value: float) -> None:
        """Change what a holding register holds, without acting."""
        self._cells["holding", address].value = value

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
        """Write whole values, or one bit as 0xFF00 or 0, in order."""
        words = list(struct.unpack(f">{len(raw) // 2}H", raw))
        if space == "coil":
            words = [int(words[0] != 0)]
        cells, at = list[tuple[Cell, int]](), 0
        while at < len(words):
            cell = self._cells.get((space, start + at))
            if cell is None or not cell.writable or at + cell.place.size > len(words):
                raise ModbusRefusedError(ILLEGAL_ADDRESS)
            cells.append((cell, at))
            at += cell.place.size
        for cell, at in cells:
            cell.write(words[at : at + cell.place.size])

    def _words(self, space: Space, start: int, count: int) -> list[int]:
        end, found = start + count, dict[int, int]()
        for at in range(start - _LONGEST + 1, end):
            cell = self._cells.get((space, at))
            if cell is None or at + cell.place.size <= start:
                continue
            cut = at < start or at + cell.place.size > end
            if not cell.readable or (self.whole and cut):
                raise ModbusRefusedError(ILLEGAL_ADDRESS)
            found.update(enumerate(cell.words(), at))
        if not found or not (self.lenient or all(at in found for at in range(start, end))):
            raise ModbusRefusedError(ILLEGAL_ADDRESS)
        return [found.get(at, 0) for at in range(start, end)]


class MemoryDevice(Device):
    """A device whose registers and bits are a memory."""

    memory: Memory

    def read(self, space: Space, address: int, count: int, connection: int) -> bytes:
        """Return registers or bits."""
        return self.memory.read(space, address, count)

    def write(self, space: Space, address: int, raw: bytes, connection: int) -> None:
        """Write registers or a bit."""
        self.memory.write(space, address, raw)
