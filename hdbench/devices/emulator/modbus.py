"""Emulated Modbus device: the register map of a profile, wired to the simulated bench."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from hdbench.devices.emulator.instrument import SimulatedInstrument
from hdbench.devices.emulator.memory import Cell, Memory
from hdbench.devices.emulator.outputs import DeviceWatchdog, Driving, told
from hdbench.devices.emulator.server import Device, Space
from hdbench.devices.emulator.serving import Emulation, ModbusWire
from hdbench.devices.modbus.identity import SIGNATURE, signature_address
from hdbench.devices.modbus.inputs import input_info
from hdbench.devices.modbus.layout import Place, place_of
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusChannel


class ModbusDevice(Device):
    """Holds the map, answers requests, and stops the motor when nobody feeds its watchdog.

    Parameters
    ----------
    instrument : SimulatedInstrument
        The bench at its terminals.
    table : ModbusAcquisition
        The map.
    amperes_per_v : float
        Motor current per volt of the instrument's current input, A/V.
    clock : callable, optional
        Monotonic clock, s.
    """

    functions = frozenset((1, 2, 3, 4, 5, 6, 16))

    def __init__(
        self,
        instrument: SimulatedInstrument,
        table: ModbusAcquisition,
        *,
        amperes_per_v: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.reply_s = table.reply_s
        self.unit = table.unit
        self.memory = Memory(table.max_read_registers, lenient=table.bridge_registers > 0)
        self._instrument = instrument
        self._table = table
        self._amperes_per_v = amperes_per_v
        self._clock = clock
        self._refreshed_s = -1.0
        self._seen: dict[str, float] = {}
        self._silent_until_s = 0.0
        self._driving: Driving | None = None
        self._build()

    @property
    def watchdog(self) -> DeviceWatchdog | None:
        """Its watchdog, None where it has none."""
        return None if self._driving is None else self._driving.watchdog

    def hears(self, function: int) -> bool:
        """Feed the watchdog; False while the device is silent."""
        self.tick()
        if self._clock() < self._silent_until_s:
            return False
        if self.watchdog is not None:
            self.watchdog.heard(function)
        return True

    def read(self, space: Space, address: int, count: int, connection: int) -> bytes:
        """Return registers or bits."""
        return self.memory.read(space, address, count)

    def write(self, space: Space, address: int, raw: bytes, connection: int) -> None:
        """Write registers or a bit."""
        self.memory.write(space, address, raw)

    def tick(self) -> None:
        """Let time pass."""
        if self.watchdog is not None:
            self.watchdog.tick()
        self._instrument.catch_up()

    def _build(self) -> None:
        table = self._table
        # no device has anything there
        place = Place("holding", signature_address(table), "u32", "ABCD", "signature")
        self.memory.add(Cell(place, float(SIGNATURE), writable=False))
        for channel in table.channels:
            cell = Cell(place_of(table, channel), on_read=partial(self._read, channel))
            cell.writable = False
            self.memory.add(cell)
            for word in (channel.status, channel.sign):
                if word is not None:
                    place = place_of(table, word)
                    self.memory.add(Cell(place, on_read=partial(self._word, place), writable=False))
        if table.output is not None:
            self._driving = Driving(self.memory, self._instrument, table, table.output, self._clock)
        for rule in table.identify:
            self.memory.add(Cell(place_of(table, rule), told(rule), writable=False))
        for write in table.init:
            self.memory.add(Cell(place_of(table, write)))

    def _read(self, channel: ModbusChannel) -> float:
        self._refresh()
        info = input_info(self._table, channel)
        if not info.wrap:
            raw = abs(self._raw(channel)) if channel.sign is not None else self._raw(channel)
            return raw if channel.type.startswith("f") else float(round(raw))
        value = self._seen[channel.role]
        count = int(value) % info.wrap
        signed = channel.type.startswith("i") and count >= info.wrap // 2
        return float(count - info.wrap if signed else count)

    def _raw(self, channel: ModbusChannel) -> float:
        """Return a channel in steps of its register, not rounded, its sign kept."""
        info = input_info(self._table, channel)
        value = min(max(self._seen[channel.role], info.low), info.high)
        return (value - channel.offset) / channel.scale

    def _word(self, place: Place) -> float:
        """Return a word of states: good ones, and the signs of channels that have theirs there."""
        self._refresh()
        word = 0
        for channel in self._table.channels:
            status, sign = channel.status, channel.sign
            if status is not None and place_of(self._table, status) == place:
                word |= status.good
            if sign is not None and place_of(self._table, sign) == place:
                word |= int(self._raw(channel) < 0.0) << sign.bit
        return float(word)

    def _refresh(self) -> None:
        """Take a new reading, no more often than the device renews its values."""
        now_s, rate = self._clock(), self._table.refresh_hz
        if rate is not None and self._seen and now_s - self._refreshed_s < 1.0 / rate:
            return
        self._refreshed_s = now_s
        looked = self._instrument.look()
        self._seen = {name: float(volts[-1]) for name, volts in looked.volts.items()}
        self._seen["current"] *= self._amperes_per_v
        self._seen["encoder"] = float(looked.count[-1])


def emulate_modbus(emulation: Emulation, table: ModbusAcquisition) -> ModbusWire:
    """Return a device with the registers of `table` and a simulated bench behind them."""
    # the instrument's current channel has max_current_a at range_v
    profile = emulation.profile
    amperes_per_v = profile.servo.max_current_a / profile.daq.range_v
    device = ModbusDevice(emulation.instrument, table, amperes_per_v=amperes_per_v)
    return ModbusWire(device, on_line=table.serial is not None)
