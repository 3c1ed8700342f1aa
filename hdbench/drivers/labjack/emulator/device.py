"""Emulated T4 or T7: its map, wired to terminals, stream and watchdog, on two TCP ports."""

from __future__ import annotations

import asyncio
import errno
import struct
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass
from functools import partial

from hdbench.devices.emulator.memory import ILLEGAL_VALUE, Cell, Memory, MemoryDevice
from hdbench.devices.emulator.server import ModbusRefusedError, ModbusServer
from hdbench.devices.emulator.serving import Emulation, EmulatorSettings
from hdbench.drivers.labjack import registers as reg
from hdbench.drivers.labjack.driver import EMULATOR_NAME, STREAM_OFFSET
from hdbench.drivers.labjack.emulator import streaming
from hdbench.drivers.labjack.scanlist import CORE_TIMER_HZ, FLASH_ADDRESS
from hdbench.drivers.labjack.table import LabJackAcquisition

_PRODUCTS = {"T4": 4, "T7": 7}
_LINES = 23
_REBOOT = 0x4C4A
_BAD_REBOOT, _BAD_RANGE = 2402, 2370
_BAD_INDEX, _EF_RUNS, _AIN_BUSY = 2551, 2566, 2605
_QUADRATURE = 10
# registers of one frame of a feedback request: their number has one byte
_MAX_REGISTERS = 255
# a reader that has not taken this much is slow: packets then wait in the device's buffer
_SLOW_BYTES = 16384


@dataclass(eq=False)
class LabJackDevice(MemoryDevice):
    """A T4 or T7 that knows the registers a bench needs."""

    functions = frozenset((3, 6, 16, 76))
    # larger than Modbus has them: a feedback request may fill a packet of Ethernet
    longest = 1040

    wiring: streaming.Wiring
    serial: int
    _: KW_ONLY
    clock: Callable[[], float] = time.monotonic

    def __post_init__(self) -> None:
        self.rebooted: Callable[[], None] = lambda: None
        self.readers: set[asyncio.WriteTransport] = set()
        self.memory = Memory(_MAX_REGISTERS, whole=True)
        self.stream = streaming.StreamEngine(
            self.memory, self.wiring, self._ticks, lambda: self.levels
        )
        self.watchdog = streaming.DeviceWatchdog(self.memory, self.clock, self._time_out)
        self.levels = self.directions = 0
        self._build(self.serial)

    def hears(self, function: int) -> bool:
        """Feed the watchdog."""
        self.watchdog.heard()
        self.watchdog.tick()
        return True

    def other(self, pdu: bytes) -> bytes:
        """Carry out a feedback request: reads and writes one after the other."""
        frames, reply = pdu[1:], b""
        while frames:
            if len(frames) < 4:
                raise ModbusRefusedError(ILLEGAL_VALUE)
            kind, address, count = struct.unpack(">BHB", frames[:4])
            frames = frames[4:]
            if kind == 0:
                reply += self.memory.read("holding", address, count)
            elif kind == 1 and len(frames) >= 2 * count:
                self.memory.write("holding", address, frames[: 2 * count])
                frames = frames[2 * count :]
            else:
                raise ModbusRefusedError(ILLEGAL_VALUE)
        return reply

    def note_refusal(self, refused: ModbusRefusedError, connection: int, transaction: int) -> None:
        """Keep it for LAST_ERR_*; what is no request at all has its exception as its reason."""
        self.memory.put(reg.LAST_ERROR[0].address, refused.reason or refused.exception)
        self.memory.put(reg.LAST_ERROR[2].address, transaction)

    def tick(self) -> None:
        """Let time pass, and send the packets that are complete."""
        # with nobody there yet, packets wait in the device's buffer, too
        slow = not self.readers or any(
            reader.get_write_buffer_size() > _SLOW_BYTES for reader in self.readers
        )
        self.watchdog.tick()
        for packet in self.stream.tick(blocked=slow):
            for reader in self.readers:
                reader.write(packet)
        self.wiring.instrument.catch_up()

    def reboot(self) -> None:
        """Restart: lines become inputs, outputs fall to zero, stream and memory are gone."""
        self.stream.stop()
        self.directions = 0
        for line in range(_LINES):
            self._set_line(line, high=False)
        for terminal in ("DAC0", "DAC1"):
            self.wiring.write_reference(terminal, 0.0)
        for register in reg.SESSION:
            self.memory.put(register.address, 0)
        self.rebooted()

    def _build(self, serial: int) -> None:
        add = self.memory.hold
        words = struct.unpack(">25H", EMULATOR_NAME.encode().ljust(50, b"\0"))
        for register, word in zip(reg.user_name(), words, strict=True):
            self.memory.add(Cell(register, word, writable=False))
        self._build_terminals()
        self._build_lines()
        self.memory.add(Cell(reg.CORE, on_read=lambda: self._ticks() % 2**32, writable=False))
        for word, register in enumerate(reg.flash_words(60)):
            self.memory.add(Cell(register, on_read=partial(self._flash, word), writable=False))
        add(61998, "u32", on_write=self._order_reboot, readable=False)
        told = {
            "TEST": 0x00112233,
            "PRODUCT_ID": _PRODUCTS[self.wiring.model],
            "HARDWARE_VERSION": 1.3,
            "FIRMWARE_VERSION": 1.0331,
            "SERIAL_NUMBER": serial,
        }
        for name, register in reg.BY_NAME.items():
            # a T4 always goes on after a full buffer
            if self.wiring.model == "T7" or register is not reg.STREAM_AUTORECOVER_DISABLE:
                cell = Cell(register, told.get(name, 0), writable=register.writable)
                self.memory.add(cell)

    def _build_terminals(self) -> None:
        add, write = self.memory.add, self.wiring.write_reference
        for number in range(14):
            read = partial(self._ain, number)
            add(Cell(reg.analog_input(number), on_read=read, writable=False))
            add(Cell(reg.analog_range(number), on_write=self._check_range))
            add(Cell(reg.negative_channel(number), 199))
            self.memory.hold(41500 + number, "u16")
        for number in (0, 1):
            add(Cell(reg.dac(number), on_write=partial(write, f"DAC{number}")))
        for number in range(22):
            tick = partial(write, f"TDAC{number}")
            add(Cell(reg.tick_dac(number), on_write=tick, readable=False))

    def _build_lines(self) -> None:
        add = self.memory.add
        for line in range(_LINES):
            level, write = partial(self._level, line), partial(self._write_line, line)
            add(Cell(reg.digital_line(line), on_read=level, on_write=write))
            enable = add(Cell(reg.ef_enable(line)))
            add(Cell(reg.ef_index(line), on_write=partial(self._check_index, enable)))
            count = partial(self._counter, line)
            self.memory.hold(reg.ef_count(line).address, "u32", on_read=count, writable=False)
        levels = reg.FIO_EIO_STATE
        self.memory.hold(levels, "u16", on_read=lambda: self.levels & 0xFFFF, writable=False)
        add(Cell(reg.DIO_STATE, on_read=lambda: self.levels, writable=False))
        self.memory.hold(2850, "u32", on_read=lambda: self.directions, writable=False)

    def _ticks(self) -> int:
        return int(self.clock() * CORE_TIMER_HZ)

    def _ain(self, number: int) -> float:
        if self.stream.running:
            raise streaming.RefusedError(_AIN_BUSY)
        range_v = self.memory.value(reg.analog_range(number).address)
        word = self.wiring.words(self.wiring.instrument.look(), number, range_v)
        return self.wiring.calibration.volts(int(word[-1]), number, range_v)

    def _counter(self, line: int) -> int:
        if line != self.wiring.counter_line or not self._paired():
            return 0
        return self.wiring.instrument.count % 2**32

    def _paired(self) -> bool:
        first = self.wiring.counter_line
        return all(
            self.memory.value(reg.ef_enable(line).address) == 1
            and self.memory.value(reg.ef_index(line).address) == _QUADRATURE
            for line in (first, first + 1)
        )

    def _check_index(self, enable: Cell, value: float) -> None:
        if enable.value:
            raise streaming.RefusedError(_EF_RUNS)
        if value not in (0, 1, 3, 4, 5, 7, 8, 9, _QUADRATURE, 11):
            raise streaming.RefusedError(_BAD_INDEX)

    def _check_range(self, value: float) -> None:
        ranges = (0.0,) if self.wiring.model == "T4" else (0.0, 10.0, 1.0, 0.1, 0.01)
        # ranges travel as 32-bit floats
        if not any(abs(value - known) <= 1e-6 * known for known in ranges):
            raise streaming.RefusedError(_BAD_RANGE)

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
            self.memory.put(reg.dac(number).address, value)
            self.wiring.write_reference(f"DAC{number}", value)

    def _flash(self, word: int) -> float:
        at = (int(self.memory.value(reg.FLASH_POINTER.address)) - FLASH_ADDRESS) // 4 + word
        floats = self.wiring.calibration.floats
        return floats[at] if 0 <= at < len(floats) else -1.0

    def _order_reboot(self, value: float) -> None:
        if int(value) >> 16 != _REBOOT:
            raise streaming.RefusedError(_BAD_REBOOT)
        self.reboot()


_PORT_TRIES = 50
_HIGHEST_PORT = 65535
_CHUNK = 4096


class EmulatedLabJack:
    """Implements `hdbench.devices.emulator.serving.EmulatedDevice`."""

    def __init__(self, device: LabJackDevice) -> None:
        self.device = device
        self._control: ModbusServer | None = None
        self._stream: asyncio.Server | None = None
        device.rebooted = self._hang_up

    async def open(self, settings: EmulatorSettings) -> Mapping[str, object]:
        """Listen on a port and on 200 above it; return ``address`` and ``stream_port``."""
        host, port = settings.host, settings.port
        for left in range(_PORT_TRIES if port == 0 else 1, 0, -1):
            control = ModbusServer(self.device)
            try:
                address = await control.open(host, port)
                above = int(address.rpartition(":")[2]) + STREAM_OFFSET
                if above > _HIGHEST_PORT:
                    raise OSError(errno.EADDRNOTAVAIL, "no port left for the stream")
                self._stream = await asyncio.start_server(self._talk, host, above)
            except OSError as error:
                control.close()
                if left > 1:
                    continue
                ports = f"ports {port} and {port + STREAM_OFFSET}: {error.strerror or error}"
                raise OSError(error.errno, ports) from error
            break
        self._control = control
        return {"address": address, "stream_port": above}

    def close(self) -> None:
        """Stop listening and end every connection."""
        if self._control is not None:
            self._control.close()
        if self._stream is not None:
            self._stream.close()
        self._hang_up()

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Have the stream sent to one more reader; nothing that it sends matters."""
        self.device.readers.add(writer.transport)
        with suppress(OSError):
            while await reader.read(_CHUNK):
                pass
        self.device.readers.discard(writer.transport)
        writer.close()

    def _hang_up(self) -> None:
        if self._control is not None:
            self._control.hang_up()
        for transport in tuple(self.device.readers):
            transport.abort()


def emulate_labjack(emulation: Emulation, table: LabJackAcquisition) -> EmulatedLabJack:
    """Return a device with a simulated bench at the terminals that `table` names."""
    terminals = emulation.terminals(table.channels)
    wiring = streaming.Wiring(emulation.instrument, table, terminals, emulation.seed)
    return EmulatedLabJack(LabJackDevice(wiring, serial_number(emulation.seed)))


def serial_number(seed: int) -> int:
    """Return the serial number that an emulated device has with this seed."""
    return seed % 999_999_999 + 1
