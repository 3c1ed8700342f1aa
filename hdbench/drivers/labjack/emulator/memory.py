"""Map of cells of the emulated device, and the watchdog whose settings stand in it."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from hdbench.devices.emulator.server import ModbusRefusedError

_FORMATS = {"u16": ">H", "u32": ">I", "f32": ">f"}
_ILLEGAL_ADDRESS, _ILLEGAL_VALUE, _DEVICE_FAILURE = 2, 3, 4


class RefusedError(ModbusRefusedError):
    """A request that the device answers with an exception."""

    def __init__(self, detail: int, exception: int = _DEVICE_FAILURE) -> None:
        super().__init__(exception)
        self.detail = detail


@dataclass(slots=True)
class Cell:
    """One value."""

    kind: str
    value: float | int = 0
    on_read: Callable[[], float | int] | None = None
    on_write: Callable[[float | int], None] | None = None
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

    def add(self, address: int, kind: str, value: float = 0, **access: Any) -> Cell:
        """Add a cell, and return it; `access` is the rest of `Cell`."""
        cell = self._cells[address] = Cell(kind, value, **access)
        return cell

    def add_all(self, addresses: Iterable[int], kind: str, value: float = 0, **access: Any) -> None:
        """Add cells of one kind."""
        for address in addresses:
            self.add(address, kind, value, **access)

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


_ENABLE, _TIMEOUT, _STRICT, _KEY, _CLEAR = 61600, 61604, 61610, 61612, 61614
_RESET, _DIO, _DIO_STATE, _DIO_DIRECTION, _DIO_INHIBIT = 61620, 61630, 61632, 61634, 61636
_ADVANCED, _STARTUP = 61602, 61606
_DAC = ((61640, 61642, 0), (61650, 61652, 1))
_SETTINGS = (
    *(_ADVANCED, _TIMEOUT, _STARTUP, _STRICT, _KEY, _RESET),
    *(_DIO, _DIO_STATE, _DIO_DIRECTION, _DIO_INHIBIT),
    *(enable for enable, _, _ in _DAC),
)
# the device's own codes: a time of zero, and writing settings while it runs
_BAD_TIME, _RUNNING = 2670, 2671


class DeviceWatchdog:
    """Counts down in real time, and drives outputs to what its registers say."""

    def __init__(
        self,
        memory: Memory,
        clock: Callable[[], float],
        act: Callable[[int, int, int, dict[int, float]], None],
    ) -> None:
        self.trips = 0
        self.flash_writes = 0
        self._memory = memory
        self._clock = clock
        self._act = act
        self._fed_s = clock()
        memory.add_all(_SETTINGS, "u32", on_write=self._set)
        memory.add_all((value for _, value, _ in _DAC), "f32", on_write=self._set)
        memory.add(_ENABLE, "u32", on_write=self._enable)
        memory.add(_CLEAR, "u32", on_write=self._clear, readable=False)

    @property
    def enabled(self) -> bool:
        """Whether it counts."""
        return bool(self._memory.value(_ENABLE))

    def heard(self) -> None:
        """Note any communication: without strict mode that is enough."""
        if not self._memory.value(_STRICT):
            self._fed_s = self._clock()

    def tick(self) -> None:
        """Act when the time is up, and start again."""
        if not self.enabled or self._clock() - self._fed_s <= self._memory.value(_TIMEOUT):
            return
        self._fed_s = self._clock()
        self.trips += 1
        dacs = {
            number: float(self._memory.value(value))
            for enable, value, number in _DAC
            if self._memory.value(enable)
        }
        state = direction = 0
        inhibit = -1
        if self._memory.value(_DIO):
            state = int(self._memory.value(_DIO_STATE))
            direction = int(self._memory.value(_DIO_DIRECTION))
            inhibit = int(self._memory.value(_DIO_INHIBIT))
        self._act(state, direction, inhibit, dacs)

    def _set(self, value: float) -> None:
        if self.enabled:
            raise RefusedError(_RUNNING)
        self.flash_writes += 1

    def _enable(self, value: float) -> None:
        if value and not self._memory.value(_TIMEOUT):
            raise RefusedError(_BAD_TIME)
        self.flash_writes += 1
        self._fed_s = self._clock()

    def _clear(self, value: float) -> None:
        if not self._memory.value(_STRICT) or value == self._memory.value(_KEY):
            self._fed_s = self._clock()
