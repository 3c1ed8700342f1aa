"""Emulated T4 or T7: its map, wired to terminals, stream and watchdog.

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
import time
from collections.abc import Callable
from functools import partial

from hdbench.devices.emulator.instrument import ChannelFault, Input
from hdbench.drivers.labjack.emulator.memory import (
    Cell,
    DeviceWatchdog,
    Memory,
    RefusedError,
)
from hdbench.drivers.labjack.emulator.streaming import (
    CORE_TIMER_HZ,
    StreamEngine,
    StreamOrder,
    Wiring,
    actual_rate_hz,
)

_RATE, _ENTRIES, _PER_PACKET, _SETTLING, _BUFFER, _SCANS = 4002, 4004, 4006, 4008, 4012, 4020
_STOP_WHEN_FULL, _LIST, _ENABLE = 4028, 4100, 4990
_PLAIN = (_ENTRIES, _PER_PACKET, 4010, _BUFFER, 4014, 4016, 4018, _SCANS)
_LONGEST = 128
# what the buffer holds where nothing is asked for
_BUFFER_BYTES = {"T4": 8192, "T7": 4096}
_NOT_RUNNING, _ACTIVE = 2620, 2605
_INPUTS = 14


class StreamRegisters:
    """Adds the stream's cells to a device's map."""

    def __init__(
        self, memory: Memory, engine: StreamEngine, wiring: Wiring, ticks: Callable[[], int]
    ) -> None:
        self._memory = memory
        self._engine = engine
        self._model = wiring.model
        self._ticks = ticks
        rate = memory.add(_RATE, "f32")
        rate.on_read = lambda: actual_rate_hz(rate.value) if rate.value > 0.0 else 0.0
        memory.add_all((*_PLAIN, *range(_LIST, _LIST + 2 * _LONGEST, 2)), "u32")
        memory.add(_SETTLING, "f32")
        if self._model == "T7":
            # a T4 has no such register: it always goes on
            memory.add(_STOP_WHEN_FULL, "u32")
        memory.add(4026, "u32", on_read=lambda: engine.start_ticks % 2**32, writable=False)
        memory.add(_ENABLE, "u32", on_read=lambda: int(engine.running), on_write=self._switch)

    def _switch(self, value: float) -> None:
        if not value:
            if not self._engine.running:
                raise RefusedError(_NOT_RUNNING)
            self._engine.stop()
            return
        if self._engine.running:
            raise RefusedError(_ACTIVE)
        self._engine.start(self._order(), self._ticks())

    def _order(self) -> StreamOrder:
        value = self._memory.value
        entries = min(int(value(_ENTRIES)), _LONGEST)
        rate_hz = float(value(_RATE))
        return StreamOrder(
            rate_hz=actual_rate_hz(rate_hz) if rate_hz > 0.0 else 0.0,
            addresses=tuple(int(value(_LIST + 2 * n)) for n in range(entries)),
            samples_per_packet=int(value(_PER_PACKET)),
            buffer_samples=(int(value(_BUFFER)) or _BUFFER_BYTES[self._model]) // 2,
            n_scans=int(value(_SCANS)),
            stop_when_full=self._model == "T7" and bool(value(_STOP_WHEN_FULL)),
            ranges_v={number: self._range_v(number) for number in range(_INPUTS)},
        )

    def _range_v(self, number: int) -> float:
        # ranges travel as 32-bit floats; 0 is the widest
        value = float(self._memory.value(40000 + 2 * number)) or 10.0
        return min((10.0, 1.0, 0.1, 0.01), key=lambda known: abs(known - value))


EMULATOR_NAME = "hdbench-emulator"
_PRODUCTS = {"T4": 4, "T7": 7}
_LINES = 23
_CALIBRATION = 0x3C4000
_REBOOT = 0x4C4A
_BAD_REBOOT, _BAD_RANGE = 2402, 2370
_BAD_INDEX, _EF_RUNS, _AIN_BUSY = 2551, 2566, 2605
_QUADRATURE = 10
# USER_RAM20_U32 and USER_RAM21_U32
_FAULT, _FAULT_ARGUMENT = 46140, 46142
_CHANNELS: tuple[Input, ...] = ("torque", "tacho", "current", "reference")
_CHANNEL_FAULTS: tuple[ChannelFault | None, ...] = (None, "stuck", "high", "low")
_ILLEGAL_VALUE = 3


class LabJackDevice:
    """A T4 or T7 that knows the registers a bench needs."""

    def __init__(
        self,
        wiring: Wiring,
        serial: int,
        *,
        clock: Callable[[], float] = time.monotonic,
        count_joint: bool = False,
    ) -> None:
        self.rebooted: Callable[[], None] = lambda: None
        self.swap_words = False
        self.wiring = wiring
        self.memory = Memory()
        self.stream = StreamEngine(wiring, lambda: self.levels, count_joint=count_joint)
        self.watchdog = DeviceWatchdog(self.memory, clock, self._time_out)
        self.levels = self.directions = 0
        self._clock = clock
        self._held_until_s = clock()
        self._build(serial)
        self._faults: dict[int, Callable[[int], None]] = {
            1: self._hold,
            2: partial(setattr, self.stream, "skip_scans"),
            3: self.stream.fail,
            4: lambda on: setattr(self, "swap_words", bool(on)),
            9: lambda _: self.reboot(),
        }

    def tick(self) -> list[bytes]:
        """Let time pass; return stream packets that are complete."""
        self.watchdog.tick()
        held = self.stream.hold
        self.stream.hold = held or self._clock() < self._held_until_s
        packets = self.stream.tick()
        self.stream.hold = held
        self.wiring.instrument.catch_up()
        return packets

    def _hold(self, time_ms: int) -> None:
        """Keep packets back for a time, as while the network is away."""
        self._held_until_s = self._clock() + 1e-3 * time_ms

    def note_error(self, error: RefusedError, transaction: int) -> None:
        """Keep a refusal for LAST_ERR_*."""
        self.memory.put(55000, error.detail)
        self.memory.put(55003, transaction)

    def reboot(self) -> None:
        """Restart: lines become inputs, outputs fall to zero, stream and memory are gone."""
        self.stream.stop()
        self.directions = 0
        for line in range(_LINES):
            self._set_line(line, high=False)
        for terminal in ("DAC0", "DAC1"):
            self.wiring.write_reference(terminal, 0.0)
        for address in (*range(46000, 46080, 2), *range(46100, 46180, 2)):
            self.memory.put(address, 0)
        self.rebooted()

    def _build(self, serial: int) -> None:
        add, add_all = self.memory.add, self.memory.add_all
        add_all((55000, 55002, 55003), "u16", writable=False)
        add_all((55100,), "u32", 0x00112233, writable=False)
        add(60000, "f32", _PRODUCTS[self.wiring.model], writable=False)
        add(60002, "f32", 1.3, writable=False)
        add(60004, "f32", 1.0331, writable=False)
        add(60010, "u32", writable=False)
        add(60028, "u32", serial, writable=False)
        add(55110, "u16", 0x11)
        add(55120, "u32", 0x00112233)
        add(55124, "f32", -9999.0)
        words = struct.unpack(">25H", EMULATOR_NAME.encode().ljust(50, b"\0"))
        for position, word in enumerate(words):
            add(60500 + position, "u16", word, writable=False)
        self._build_terminals()
        self._build_lines()
        StreamRegisters(self.memory, self.stream, self.wiring, self._ticks)
        add_all(range(46000, 46080, 2), "f32")
        add_all(range(46100, 46180, 2), "u32")
        add(_FAULT, "u32", on_write=self._break)
        add(61520, "u32", on_read=lambda: self._ticks() % 2**32, writable=False)
        add(61810, "u32")
        for word in range(60):
            add(61812 + 2 * word, "f32", on_read=partial(self._flash, word), writable=False)
        add(61998, "u32", on_write=self._order_reboot, readable=False)

    def _build_terminals(self) -> None:
        add, write = self.memory.add, self.wiring.write_reference
        for number in range(14):
            add(2 * number, "f32", on_read=partial(self._ain, number), writable=False)
            add(40000 + 2 * number, "f32", on_write=self._check_range)
            add(41000 + number, "u16", 199)
            add(41500 + number, "u16")
        for number in (0, 1):
            add(1000 + 2 * number, "f32", on_write=partial(write, f"DAC{number}"))
        for number in range(22):
            tick = partial(write, f"TDAC{number}")
            add(30000 + 2 * number, "f32", on_write=tick, readable=False)

    def _build_lines(self) -> None:
        add = self.memory.add
        for line in range(_LINES):
            level, write = partial(self._level, line), partial(self._write_line, line)
            add(2000 + line, "u16", on_read=level, on_write=write)
            enable = add(44000 + 2 * line, "u32")
            add(44100 + 2 * line, "u32", on_write=partial(self._check_index, enable))
            add(3000 + 2 * line, "u32", on_read=partial(self._counter, line), writable=False)
        add(2580, "u16", on_read=lambda: self.levels & 0xFFFF, writable=False)
        add(2800, "u32", on_read=lambda: self.levels, writable=False)
        add(2850, "u32", on_read=lambda: self.directions, writable=False)

    def _break(self, value: float) -> None:
        """Carry out a fault that a campaign orders; the module's table says which."""
        code, argument = int(value), int(self.memory.value(_FAULT_ARGUMENT))
        channel = code - 5
        if code in self._faults:
            self._faults[code](argument)
        elif 0 <= channel < len(_CHANNELS) and argument < len(_CHANNEL_FAULTS):
            self.wiring.instrument.disturb(_CHANNELS[channel], _CHANNEL_FAULTS[argument])
        elif code:
            raise RefusedError(_ILLEGAL_VALUE, _ILLEGAL_VALUE)

    def _ticks(self) -> int:
        return int(self._clock() * CORE_TIMER_HZ)

    def _ain(self, number: int) -> float:
        if self.stream.running:
            raise RefusedError(_AIN_BUSY)
        range_v = float(self.memory.value(40000 + 2 * number))
        word = self.wiring.words(self.wiring.instrument.look(), number, range_v)
        return self.wiring.calibration.volts(int(word[-1]), number, range_v)

    def _counter(self, line: int) -> int:
        if line != self.wiring.counter_line or not self._paired():
            return 0
        return self.wiring.instrument.count % 2**32

    def _paired(self) -> bool:
        first = self.wiring.counter_line
        return all(
            self.memory.value(44000 + 2 * line) == 1
            and self.memory.value(44100 + 2 * line) == _QUADRATURE
            for line in (first, first + 1)
        )

    def _check_index(self, enable: Cell, value: float) -> None:
        if enable.value:
            raise RefusedError(_EF_RUNS)
        if value not in (0, 1, 3, 4, 5, 7, 8, 9, _QUADRATURE, 11):
            raise RefusedError(_BAD_INDEX)

    def _check_range(self, value: float) -> None:
        ranges = (0.0,) if self.wiring.model == "T4" else (0.0, 10.0, 1.0, 0.1, 0.01)
        # ranges travel as 32-bit floats
        if not any(abs(value - known) <= 1e-6 * known for known in ranges):
            raise RefusedError(_BAD_RANGE)

    def _level(self, line: int) -> int:
        return self.levels >> line & 1

    def _write_line(self, line: int, value: float) -> None:
        self.directions |= 1 << line
        self._set_line(line, high=bool(value))

    def _set_line(self, line: int, *, high: bool) -> None:
        self.levels = self.levels & ~(1 << line) | int(high) << line
        self.wiring.write_line(line, high=high)

    def _time_out(self, state: int, direction: int, inhibit: int, dacs: dict[int, float]) -> None:
        for line in range(_LINES):
            if not inhibit >> line & 1 and direction >> line & 1:
                self.directions |= 1 << line
                self._set_line(line, high=bool(state >> line & 1))
        for number, value in dacs.items():
            self.memory.put(1000 + 2 * number, value)
            self.wiring.write_reference(f"DAC{number}", value)

    def _flash(self, word: int) -> float:
        at = (int(self.memory.value(61810)) - _CALIBRATION) // 4 + word
        floats = self.wiring.calibration.floats
        return floats[at] if 0 <= at < len(floats) else -1.0

    def _order_reboot(self, value: float) -> None:
        if int(value) >> 16 != _REBOOT:
            raise RefusedError(_BAD_REBOOT)
        self.reboot()
