"""The emulated device's registers and bits, and what reading and writing them does."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

from hdbench.devices.modbus.layout import Place
from hdbench.devices.modbus.values import decode, encode, range_of

__all__ = ["DEVICE_FAILURE", "ILLEGAL_VALUE", "Cell", "Memory", "RefusedError"]

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE = 1, 2, 3, 4
_READS = {1: "coil", 2: "discrete", 3: "holding", 4: "input"}
_MAX_REGISTERS, _MAX_BITS = 125, 2000


class RefusedError(Exception):
    """A request that the device answers with an exception.

    Parameters
    ----------
    code : int
        Modbus exception code.
    """

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code}")
        self.code = code


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
        Takes what was written; may raise `RefusedError`, and then nothing is kept.
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

    def answer(self, pdu: bytes) -> bytes:
        """Return the reply to one request; refusals are exceptions in it."""
        try:
            return self._carry_out(pdu)
        except RefusedError as refused:
            return bytes((pdu[0] | 0x80, refused.code))
        except (struct.error, IndexError):
            # shorter or longer than its function asks for
            return bytes((pdu[0] | 0x80, ILLEGAL_VALUE))

    def _carry_out(self, pdu: bytes) -> bytes:
        function = pdu[0]
        if function in _READS:
            start, count = struct.unpack(">HH", pdu[1:])
            return bytes((function,)) + self._read(_READS[function], start, count)
        if function == 5:
            start, value = struct.unpack(">HH", pdu[1:])
            if value not in (0, 0xFF00):
                raise RefusedError(ILLEGAL_VALUE)
            self._write("coil", start, [int(value != 0)])
            return pdu
        if function == 6:
            start, value = struct.unpack(">HH", pdu[1:])
            self._write("holding", start, [value])
            return pdu
        if function == 16:
            start, count, n_bytes = struct.unpack(">HHB", pdu[1:6])
            if n_bytes != 2 * count or len(pdu) != 6 + n_bytes:
                raise RefusedError(ILLEGAL_VALUE)
            self._write("holding", start, list(struct.unpack(f">{count}H", pdu[6:])))
            return pdu[:5]
        raise RefusedError(ILLEGAL_FUNCTION)

    def _read(self, space: str, start: int, count: int) -> bytes:
        bits = space in ("coil", "discrete")
        if not 1 <= count <= (_MAX_BITS if bits else self.max_registers):
            raise RefusedError(ILLEGAL_VALUE)
        words = self._words(space, start, count)
        if not bits:
            return bytes((2 * count,)) + struct.pack(f">{count}H", *words)
        packed = sum(bit << number for number, bit in enumerate(words))
        n_bytes = (count + 7) // 8
        return bytes((n_bytes,)) + packed.to_bytes(n_bytes, "little")

    def _words(self, space: str, start: int, count: int) -> list[int]:
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
            raise RefusedError(ILLEGAL_ADDRESS)
        return [found.get(at, 0) for at in wanted]

    def _write(self, space: str, start: int, words: list[int]) -> None:
        at = 0
        while at < len(words):
            cell = self._cells.get((space, start + at))
            if cell is None or not cell.writable or at + cell.place.size > len(words):
                raise RefusedError(ILLEGAL_ADDRESS)
            raw = struct.pack(f">{cell.place.size}H", *words[at : at + cell.place.size])
            value: float = (
                words[at] if cell.place.is_bit else decode(raw, cell.place.kind, cell.place.order)
            )
            if cell.on_write is not None:
                cell.on_write(value)
            cell.value = value
            at += cell.place.size
