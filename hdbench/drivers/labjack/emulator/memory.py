"""The device's flat map: cells of one type each, with what a read or a write of them does."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

from hdbench.devices.emulator.server import ModbusRefusedError

__all__ = ["Cell", "Memory", "RefusedError"]

_FORMATS = {"u16": ">H", "u32": ">I", "f32": ">f"}
_ILLEGAL_ADDRESS, _ILLEGAL_VALUE, _DEVICE_FAILURE = 2, 3, 4


class RefusedError(ModbusRefusedError):
    """A request that the device answers with an exception.

    Parameters
    ----------
    detail : int
        The device's own error code.
    exception : int
        Modbus exception code.
    """

    def __init__(self, detail: int, exception: int = _DEVICE_FAILURE) -> None:
        super().__init__(exception)
        self.detail = detail


@dataclass(slots=True)
class Cell:
    """One value.

    Parameters
    ----------
    kind : str
        ``u16``, ``u32`` or ``f32``.
    value : float or int
        What it holds.
    on_read, on_write : callable or None
        Give the value in place of `value`; act on a written one, before it is kept.
    readable, writable : bool
        Access.
    """

    kind: str
    value: float | int = 0
    on_read: Callable[[], float | int] | None = field(default=None)
    on_write: Callable[[float | int], None] | None = field(default=None)
    readable: bool = True
    writable: bool = True

    @property
    def size(self) -> int:
        """Number of 16-bit registers."""
        return 1 if self.kind == "u16" else 2

    def read(self) -> bytes:
        """Return the bytes of the value now."""
        value = self.value if self.on_read is None else self.on_read()
        return struct.pack(_FORMATS[self.kind], value)

    def write(self, raw: bytes) -> None:
        """Act on a written value and keep it."""
        value: float | int = struct.unpack(_FORMATS[self.kind], raw)[0]
        if self.on_write is not None:
            self.on_write(value)
        self.value = value


class Memory:
    """All cells by address."""

    def __init__(self) -> None:
        self._cells: dict[int, Cell] = {}

    def add(self, address: int, cell: Cell) -> Cell:
        """Add a cell, and return it."""
        self._cells[address] = cell
        return cell

    def value(self, address: int) -> float | int:
        """Return what a cell holds."""
        return self._cells[address].value

    def put(self, address: int, value: float) -> None:
        """Change what a cell holds, without acting."""
        self._cells[address].value = value

    def read(self, address: int, count: int) -> bytes:
        """Return the bytes of whole adjacent cells."""
        raw = b""
        for cell in self._span(address, count):
            if not cell.readable:
                raise RefusedError(_ILLEGAL_ADDRESS, _ILLEGAL_ADDRESS)
            raw += cell.read()
        return raw

    def write(self, address: int, raw: bytes) -> None:
        """Write whole adjacent cells, in order."""
        for cell in self._span(address, len(raw) // 2):
            if not cell.writable:
                raise RefusedError(_ILLEGAL_ADDRESS, _ILLEGAL_ADDRESS)
            cell.write(raw[: 2 * cell.size])
            raw = raw[2 * cell.size :]

    def _span(self, address: int, count: int) -> list[Cell]:
        cells: list[Cell] = []
        end = address + count
        while address < end:
            cell = self._cells.get(address)
            if cell is None or address + cell.size > end:
                raise RefusedError(_ILLEGAL_ADDRESS, _ILLEGAL_ADDRESS)
            cells.append(cell)
            address += cell.size
        return cells
