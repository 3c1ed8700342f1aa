"""The emulated device's flat map of cells, its watchdog, and faults ordered over its own wire.

A campaign that runs the emulator in another process writes an argument to USER_RAM21_U32 (46142)
and then a code to USER_RAM20_U32 (46140); a real device ignores both.

| code | fault | argument |
|---|---|---|
| 1 | the network is away: packets stay in the device's buffer | ms |
| 2 | scans vanish without a word (an index jump) | scans |
| 3 | the stream ends | status, 2942 to 2945 |
| 4 | a gateway swaps the words of 32-bit values | 1 on, 0 off |
| 5, 6, 7, 8 | torque, tacho, current, reference input | 0 mended, 1 stuck, 2 high, 3 low |
| 9 | the device restarts | - |
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

from hdbench.devices.emulator.instrument import ChannelFault, Input
from hdbench.devices.emulator.server import ModbusRefusedError

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


CODE, ARGUMENT = 46140, 46142
_CHANNELS: tuple[Input, ...] = ("torque", "tacho", "current", "reference")
_FAULTS: tuple[ChannelFault | None, ...] = (None, "stuck", "high", "low")

FaultActs = dict[int, Callable[[int], None]]


class Injection:
    """Adds the two cells to a device's map.

    Parameters
    ----------
    memory : Memory
        The device's map.
    acts : dict of int to callable
        What the codes 1, 2, 3, 4 and 9 do with their argument.
    disturb : callable
        ``disturb(channel, fault)`` breaks or mends an input.
    """

    def __init__(
        self,
        memory: Memory,
        acts: FaultActs,
        disturb: Callable[[Input, ChannelFault | None], None],
    ) -> None:
        self._memory = memory
        self._acts = acts
        self._disturb = disturb
        memory.add(ARGUMENT, Cell("u32"))
        memory.add(CODE, Cell("u32", on_write=self._order))

    def _order(self, value: float) -> None:
        code, argument = int(value), int(self._memory.value(ARGUMENT))
        channel = code - 5
        if code in self._acts:
            self._acts[code](argument)
        elif 0 <= channel < len(_CHANNELS) and argument < len(_FAULTS):
            self._disturb(_CHANNELS[channel], _FAULTS[argument])
        elif code:
            raise RefusedError(_ILLEGAL_VALUE, _ILLEGAL_VALUE)


_ENABLE, _TIMEOUT, _STRICT, _KEY, _CLEAR = 61600, 61604, 61610, 61612, 61614
_RESET, _DIO, _DIO_STATE, _DIO_DIRECTION, _DIO_INHIBIT = 61620, 61630, 61632, 61634, 61636
_ADVANCED, _STARTUP = 61602, 61606
_DAC = ((61640, 61642, 0), (61650, 61652, 1))
# the device's own codes: a time of zero, and writing settings while it runs
_BAD_TIME, _RUNNING = 2670, 2671


class DeviceWatchdog:
    """Counts down in real time, and drives outputs to what its registers say.

    Parameters
    ----------
    memory : Memory
        The device's map; the watchdog adds its own cells.
    clock : callable
        Monotonic clock, s.
    act : callable
        ``act(state, direction, inhibit, dacs)``: carries a timeout out.
    """

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
        for address in (_ADVANCED, _TIMEOUT, _STARTUP, _STRICT, _KEY, _RESET, _DIO, _DIO_STATE):
            self._setting(address, "u32")
        for address in (_DIO_DIRECTION, _DIO_INHIBIT):
            self._setting(address, "u32")
        for enable, value, _ in _DAC:
            self._setting(enable, "u32")
            self._setting(value, "f32")
        memory.add(_ENABLE, Cell("u32", on_write=self._enable))
        memory.add(_CLEAR, Cell("u32", on_write=self._clear, readable=False))

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

    def _setting(self, address: int, kind: str) -> None:
        self._memory.add(address, Cell(kind, on_write=self._set))

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
