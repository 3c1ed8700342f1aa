"""Stream engine of the emulated device: terminals, scans on its clock, buffer and packets."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.emulator.instrument import ElectricalSamples, SimulatedInstrument, Terminal
from hdbench.devices.emulator.memory import DEVICE_FAILURE, Cell, Memory
from hdbench.devices.emulator.server import ModbusRefusedError
from hdbench.drivers.labjack import registers as reg
from hdbench.drivers.labjack import scanlist
from hdbench.drivers.labjack.table import LabJackAcquisition
from hdbench.records.trace import FloatArray


class RefusedError(ModbusRefusedError):
    """A request that the device answers with an exception."""

    def __init__(self, code: int) -> None:
        super().__init__(DEVICE_FAILURE, code)


# the device's own codes: a time of zero, and writing settings while it runs
_BAD_TIME, _RUNNING = 2670, 2671


@dataclass(eq=False)
class DeviceWatchdog:
    """Counts down in real time, and drives outputs to what its registers say."""

    memory: Memory
    clock: Callable[[], float]
    act: Callable[[int, int, int, dict[int, float]], None]

    def __post_init__(self) -> None:
        self.trips = 0
        self.flash_writes = 0
        self._fed_s = self.clock()
        enable, *settings = reg.WATCHDOG
        self.memory.add(Cell(enable, on_write=self._enable))
        for register in settings:
            self.memory.add(Cell(register, on_write=self._set))
        self.memory.add(Cell(reg.STRICT_CLEAR, on_write=self._clear, readable=False))

    @property
    def enabled(self) -> bool:
        """Whether it counts."""
        return bool(self._setting("ENABLE"))

    def heard(self) -> None:
        """Note any communication: without strict mode that is enough."""
        if not self._setting("STRICT_ENABLE"):
            self._fed_s = self.clock()

    def tick(self) -> None:
        """Act when the time is up, and start again."""
        if not self.enabled or self.clock() - self._fed_s <= self._setting("TIMEOUT_S"):
            return
        self._fed_s = self.clock()
        self.trips += 1
        dacs = {n: self._setting(f"DAC{n}") for n in (0, 1) if self._setting(f"DAC{n}_ENABLE")}
        state = direction = 0
        inhibit = -1
        if self._setting("DIO_ENABLE"):
            names = ("DIO_STATE", "DIO_DIRECTION", "DIO_INHIBIT")
            state, direction, inhibit = (int(self._setting(name)) for name in names)
        self.act(state, direction, inhibit, dacs)

    def _setting(self, name: str) -> float:
        return self.memory.value(reg.BY_NAME[f"WATCHDOG_{name}_DEFAULT"].address)

    def _set(self, value: float) -> None:
        if self.enabled:
            raise RefusedError(_RUNNING)
        self.flash_writes += 1

    def _enable(self, value: float) -> None:
        if value and not self._setting("TIMEOUT_S"):
            raise RefusedError(_BAD_TIME)
        self.flash_writes += 1
        self._fed_s = self.clock()

    def _clear(self, value: float) -> None:
        if not self._setting("STRICT_ENABLE") or value == self._setting("STRICT_KEY"):
            self._fed_s = self.clock()


# nominal constants of the T7's high-speed converter, one group per gain, and of the T4's inputs
_T7_SLOPE, _T7_CENTER = 3.1580578e-4, 33523.0
_T4_HIGH = (3.235316e-4, -10.532965)
_T4_LOW = (3.826692e-5, 0.002484)
# how far one device is from the nominal one: a fraction of the data sheet's tolerance
_SPREAD = 2e-3
# a streamed analog input never reads 0xFFFF
_TOP = 0xFFFE


@dataclass(frozen=True, slots=True)
class Calibration:
    """The constants of one device, as its flash holds them."""

    model: str
    floats: tuple[float, ...]

    @classmethod
    def draw(cls, model: str, seed: int) -> Calibration:
        """Return the constants of the device with this serial number."""
        rng = np.random.default_rng([seed, 7])
        factor = 1.0 + _SPREAD * rng.uniform(-1.0, 1.0, 16)
        values: list[float] = []
        if model == "T7":
            for number in range(8):
                slope = _T7_SLOPE * scanlist.T7_RANGES_V[number % 4] / 10.0 * factor[number]
                values += [slope, -slope * factor[8 + number], _T7_CENTER + number, -slope * 33524]
        else:
            for number in range(5):
                slope, offset = _T4_HIGH if number < 4 else _T4_LOW
                values += [slope * factor[number], offset * factor[8 + number]]
        values += [0.0] * (scanlist.FLASH_WORDS[model] - len(values))
        return cls(model, tuple(np.array(values, dtype=np.float32).astype(float).tolist()))

    def words(self, volts: FloatArray, number: int, range_v: float) -> NDArray[np.uint16]:
        """Return the 16-bit words that AIN`number` streams for `volts`."""
        positive, negative, center = self._constants(number, range_v)
        # a 12-bit converter: its lowest four bits stay zero
        step = 16.0 if self.model == "T4" else 1.0
        raw = np.where(volts >= 0.0, volts / positive, -volts / negative) + center
        words: NDArray[np.uint16] = np.clip(np.rint(raw / step) * step, 0, _TOP).astype(np.uint16)
        return words

    def volts(self, word: int, number: int, range_v: float) -> float:
        """Return the volts that the device itself makes of a word."""
        positive, negative, center = self._constants(number, range_v)
        return (word - center) * positive if word >= center else (center - word) * negative

    def _constants(self, number: int, range_v: float) -> tuple[float, ...]:
        """Return positive slope, negative slope and centre of an input."""
        if self.model == "T7":
            at = 4 * scanlist.T7_RANGES_V.index(range_v or 10.0)
            return self.floats[at : at + 3]
        at = 2 * min(number, 4)
        slope, offset = self.floats[at : at + 2]
        return slope, -slope, -offset / slope


@dataclass(eq=False)
class Wiring:
    """Terminals of the device to the instrument, as a profile says."""

    instrument: SimulatedInstrument
    table: LabJackAcquisition
    terminals: Mapping[int, Terminal]
    seed: int

    def __post_init__(self) -> None:
        self.model = self.table.model
        self.calibration = Calibration.draw(self.model, self.seed)

    @property
    def counter_line(self) -> int:
        """Line of the pair whose counter holds the encoder's count."""
        return scanlist.QUADRATURE_LINES[self.model][0]

    def write_reference(self, terminal: str, value_v: float) -> None:
        """Put a voltage out at a terminal; only that of the reference leads anywhere."""
        if self.table.output is not None and terminal == self.table.output.output:
            self.instrument.write_reference(value_v)

    def write_line(self, line: int, *, high: bool) -> None:
        """Set a line; only that of the enable leads anywhere."""
        output = self.table.output
        if output is not None and line == output.enable_line:
            on = high == output.enable_high
            if on != self.instrument.enabled:
                self.instrument.write_enable(on=on)

    def words(self, samples: ElectricalSamples, number: int, range_v: float) -> NDArray[np.uint16]:
        """Return what AIN`number` reads; an open terminal reads 0 V."""
        name, factor = self.terminals.get(number, (None, 1.0))
        volts = np.zeros(len(samples)) if name is None else samples.volts[name] * factor
        return self.calibration.words(volts, number, range_v)


_HEADER = struct.Struct(">HHHBBBBHHH")
_JOINT = 0xFFFF
# scans taken from the bench at once
_TAKE = 4096
# longest scan list that fits the rate limit of the model, samples/s
_LIMIT_HZ = {"T7": 100_000.0, "T4": 50_000.0}
# where in a scan the timer is read, ticks: 25 us after its first input
_TIMER_OFFSET = 1000

RECOVERING, RECOVERED, OVERLAP, UNCOUNTED, BURST, FULL = range(2940, 2946)
_AIN_END, _TIMER = 500, reg.CORE.address
_LINES, _CAPTURE = reg.FIO_EIO_STATE, reg.STREAM_CAPTURE_16


_LONGEST = 128
# what the buffer holds where nothing is asked for
_BUFFER_BYTES = {"T4": 8192, "T7": 4096}
_NOT_RUNNING, _ACTIVE = 2620, 2605
_INPUTS = 14


def actual_rate_hz(rate_hz: float) -> float:
    """Return the rate that the device's divider makes of the one asked for; 0 of 0."""
    if not rate_hz > 0.0:
        return 0.0
    for divider in (8, 80, 800, 8000, 80_000):
        roll = round(80e6 / (divider * rate_hz))
        if roll <= 65536:
            return 80e6 / (divider * max(roll, 1))
    return 80e6 / (80_000 * 65536)


@dataclass(eq=False)
class StreamEngine:
    """One stream session."""

    memory: Memory
    wiring: Wiring
    ticks: Callable[[], int]
    levels: Callable[[], int]

    def __post_init__(self) -> None:
        self.running = False
        self.start_ticks = 0
        # whether the scan that marks the joint counts as skipped, too: no document says so
        self.count_joint = False
        self._rows: deque[NDArray[np.uint16]] = deque()
        rate = self.memory.add(Cell(reg.STREAM_SETUP[0]))
        rate.on_read = lambda: actual_rate_hz(rate.value)
        for number in range(_LONGEST):
            self.memory.add(Cell(reg.scan_list(number)))
        enabled = Cell(reg.STREAM_ENABLE, on_read=lambda: int(self.running), on_write=self._switch)
        self.memory.add(enabled)
        self.memory.hold(4026, "u32", on_read=lambda: self.start_ticks % 2**32, writable=False)

    def _switch(self, value: float) -> None:
        if bool(value) == self.running:
            raise RefusedError(_ACTIVE if value else _NOT_RUNNING)
        if value:
            self._start()
        else:
            self.stop()

    def _setting(self, name: str) -> int:
        return int(self.memory.value(reg.BY_NAME[f"STREAM_{name}"].address))

    def _range_v(self, number: int) -> float:
        # ranges travel as 32-bit floats; 0 is the widest
        value = self.memory.value(reg.analog_range(number).address) or 10.0
        return min(scanlist.T7_RANGES_V, key=lambda known: abs(known - value))

    def _start(self) -> None:
        """Scan as the registers ask for, from the beginning."""
        setting, model = self._setting, self.wiring.model
        entries = min(setting("NUM_ADDRESSES"), _LONGEST)
        self._rate_hz = actual_rate_hz(self.memory.value(reg.STREAM_SETUP[0].address))
        lists = [self.memory.value(reg.scan_list(number).address) for number in range(entries)]
        self._addresses = [int(address) for address in lists]
        self._samples_per_packet = setting("SAMPLES_PER_PACKET")
        self._buffer_samples = (setting("BUFFER_SIZE_BYTES") or _BUFFER_BYTES[model]) // 2
        self._n_scans = setting("NUM_SCANS")
        self._stops_when_full = model == "T7" and bool(setting("AUTORECOVER_DISABLE"))
        self._ranges_v = [self._range_v(number) for number in range(_INPUTS)]
        self._check()
        self._rows.clear()
        self._number = self._taken = self._status = 0
        self._skipped: int | None = None
        self._joint: int | None = None
        self.start_ticks = self.ticks() + round(scanlist.CORE_TIMER_HZ / self._rate_hz)
        self.wiring.instrument.begin(1.0 / self._rate_hz)
        self.running = True

    def stop(self) -> None:
        """Stop scanning; what is in the buffer is gone."""
        if self.running:
            self.wiring.instrument.end()
        self.running = False
        self._rows.clear()

    def tick(self, *, blocked: bool = False) -> list[bytes]:
        """Scan what is due and return the packets that are complete, none while blocked."""
        if not self.running:
            return []
        self._scan()
        packets: list[bytes] = []
        scans = self._samples_per_packet // len(self._addresses)
        while not blocked and len(self._rows) >= scans:
            packets.append(self._packet(scans))
        if not blocked:
            self._recover(scans)
        if self._status in (OVERLAP, UNCOUNTED, FULL, BURST) and not blocked:
            # less than a packet is left: it carries the status
            packets.append(self._packet(len(self._rows), self._status))
            self.stop()
        return packets

    def _scan(self) -> None:
        samples = self.wiring.instrument.take(_TAKE)
        if not len(samples) or self._status:
            return
        words = np.stack([self._column(samples, n) for n in range(len(self._addresses))], 1)
        room = self._buffer_samples // len(self._addresses) - len(self._rows)
        for row in words:
            if self._skipped is not None:
                self._skipped += 1
            elif room > 0:
                self._rows.append(row)
                room -= 1
            elif self._stops_when_full:
                self._status = FULL
                break
            else:
                self._skipped = 1
        self._taken += len(words)
        if self._n_scans and self._taken >= self._n_scans and not self._status:
            self._status = BURST

    def _recover(self, scans: int) -> None:
        """Take new scans again once the buffer has been emptied."""
        if self._skipped is None or len(self._rows) >= scans:
            return
        if self._skipped > 0xFFFF:
            self._status = UNCOUNTED
            return
        self._joint = self._skipped + self.count_joint
        self._skipped = None
        self._rows.append(np.full(len(self._addresses), _JOINT, dtype=np.uint16))

    def _packet(self, scans: int, status: int = 0) -> bytes:
        rows = [self._rows.popleft() for _ in range(scans)]
        backlog = 2 * len(self._addresses) * len(self._rows)
        additional = 0
        if self._skipped is not None and not status:
            status = RECOVERING
        if self._joint is not None and any(row[0] == _JOINT for row in rows):
            status, additional, self._joint = RECOVERED, self._joint, None
        data = np.concatenate(rows).astype(">u2").tobytes() if rows else b""
        number, self._number = self._number, (self._number + 1) % 0x10000
        head = (number, 0, 10 + len(data), 1, 76, 16, 0, backlog, status, additional)
        return _HEADER.pack(*head) + data

    def _column(self, samples: ElectricalSamples, position: int) -> NDArray[np.uint16]:
        address = self._addresses[position]
        if address < _AIN_END:
            return self.wiring.words(samples, address // 2, self._ranges_v[address // 2])
        if address == _LINES:
            return np.full(len(samples), self.levels() & 0xFFFF, dtype=np.uint16)
        # the upper half of a 32-bit value stands at the capture address right behind it
        upper = address == _CAPTURE
        if upper:
            address = self._addresses[position - 1]
        wide = self._wide(samples, address) % 2**32
        word: NDArray[np.uint16] = (wide >> 16 if upper else wide & 0xFFFF).astype(np.uint16)
        return word

    def _wide(self, samples: ElectricalSamples, address: int) -> NDArray[np.int64]:
        if address == _TIMER:
            index = samples.first_index + np.arange(len(samples), dtype=np.int64)
            ticks = np.rint(index * (scanlist.CORE_TIMER_HZ / self._rate_hz)).astype(np.int64)
            timer: NDArray[np.int64] = ticks + self.start_ticks + _TIMER_OFFSET
            return timer
        return samples.count

    def _check(self) -> None:
        entries = len(self._addresses)
        if not 1 <= entries <= 128:
            raise RefusedError(2600)
        if not 0.0 < self._rate_hz * entries <= _LIMIT_HZ[self.wiring.model]:
            raise RefusedError(2608)
        if self._buffer_samples not in [2**n for n in range(8, 15)]:
            raise RefusedError(2615)
        if not 1 <= self._samples_per_packet <= 512:
            raise RefusedError(2618)
        counter = reg.ef_count(self.wiring.counter_line).address
        known = {_LINES, _CAPTURE, _TIMER, counter}
        for position, address in enumerate(self._addresses):
            analog = address < _AIN_END and address % 2 == 0
            after = self._addresses[position - 1] if position else 0
            if address == _CAPTURE and after not in (_TIMER, counter):
                raise RefusedError(2607)
            if not (analog or address in known):
                raise RefusedError(2625)
