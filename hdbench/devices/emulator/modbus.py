"""Emulated Modbus device: the registers of a profile, its outputs and watchdog."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from functools import partial
from typing import Any

from hdbench.devices.emulator.instrument import SimulatedInstrument
from hdbench.devices.emulator.memory import DEVICE_FAILURE, Cell, Memory, MemoryDevice
from hdbench.devices.emulator.server import ModbusRefusedError
from hdbench.devices.emulator.serving import Emulation, ModbusWire
from hdbench.devices.modbus.identity import SIGNATURE, signature_address
from hdbench.devices.modbus.inputs import input_info
from hdbench.devices.modbus.layout import place_of
from hdbench.devices.registers import Register, Space
from hdbench.profile import acquiring_modbus

# what a coupler has as its time when it is switched on, s
_FACTORY_S = 1.0


@dataclass(eq=False)
class DeviceWatchdog:
    """Trips when it was not fed in time; runs from the first feeding on.

    Parameters
    ----------
    spec : ModbusWatchdog
        As the profile describes it.
    trip : callable
        Called once when it trips.
    clock : callable
        Monotonic clock, s.
    """

    spec: acquiring_modbus.ModbusWatchdog
    trip: Callable[[], None]
    clock: Callable[[], float]

    def __post_init__(self) -> None:
        self.tripped = False
        self.steps = round(_FACTORY_S / self.spec.unit_s)
        self._fed_s: float | None = None
        self._cleared = 0

    def heard(self, function: int) -> None:
        """Note a request that feeds it, where any request or any write does."""
        writes = function in (5, 6, 15, 16)
        if self.spec.fed_by == "message" or (self.spec.fed_by == "write" and writes):
            self._feed()

    def fed(self, value: float) -> None:
        """Note a write to the feeding register."""
        feed = self.spec.feed
        if feed is not None and (feed.kind != "key" or value == feed.value):
            self._feed()

    def tick(self) -> None:
        """Trip when the time is over."""
        if self.tripped or self._fed_s is None or not self.steps:
            return
        if self.clock() - self._fed_s > self.steps * self.spec.unit_s:
            self.tripped = True
            self.trip()

    def clear(self, number: int, value: float) -> None:
        """Note a write of the clearing sequence; after the last of them the trip is gone."""
        right = value == self.spec.clear[number].value and number == self._cleared
        self._cleared = number + 1 if right else 0
        if self._cleared == len(self.spec.clear):
            self._cleared, self.tripped, self._fed_s = 0, False, None

    def status(self) -> float:
        """Return what its status register reads."""
        rule = self.spec.tripped
        return told(rule) if self.tripped else otherwise(rule)

    def _feed(self) -> None:
        if self.tripped and not self.spec.latches:
            self.tripped = False
        if not self.tripped:
            self._fed_s = self.clock()


def told(rule: acquiring_modbus.ModbusIdentify) -> float:
    """Return a value that keeps a rule."""
    if rule.equals is not None:
        return rule.equals
    return rule.low if rule.low is not None else rule.high or 0.0


def otherwise(rule: acquiring_modbus.ModbusIdentify) -> float:
    """Return a value that breaks a rule."""
    if rule.mask is not None:
        return float(int(told(rule)) ^ rule.mask)
    if rule.equals is not None:
        return 1.0 if rule.equals == 0.0 else 0.0
    return (rule.low or 0.0) - 1.0 if rule.low is not None else (rule.high or 0.0) + 1.0


class Driving:
    """Puts the cells of ``[daq.output]`` into a map and acts on what is written to them.

    Parameters
    ----------
    device : ModbusDevice
        Holds the map.
    output : ModbusOutput
        ``[daq.output]``.
    """

    def __init__(self, device: ModbusDevice, output: acquiring_modbus.ModbusOutput) -> None:
        add = device.add
        self.watchdog: DeviceWatchdog | None = None
        self._instrument = device.instrument
        self._output = output
        self._zero = -output.offset / output.scale
        self._reference = add(output, self._zero, on_write=self._write)
        if output.read_back is not None:
            add(output.read_back, on_read=lambda: self._reference.value, writable=False)
        self._enable: Cell | None = None
        if output.enable is not None:
            off = output.enable.off
            self._enable = add(output.enable, float(off), on_write=partial(self._switch, off))
        if output.watchdog is not None:
            spec = output.watchdog
            self.watchdog = DeviceWatchdog(spec, lambda: self.make_safe(*spec.drops), device.clock)
            self._add_watchdog(add, self.watchdog)

    def make_safe(self, *names: str) -> None:
        """Let outputs fall to zero and off."""
        if "reference" in names:
            self._reference.value = self._zero
            self._instrument.write_reference(0.0)
        if "enable" in names and self._enable is not None and self._output.enable is not None:
            self._enable.value = float(self._output.enable.off)
            self._instrument.write_enable(on=False)

    def _add_watchdog(self, add: Callable[..., Cell], watchdog: DeviceWatchdog) -> None:
        spec = watchdog.spec

        def set_time(value: float) -> None:
            watchdog.steps = int(value)

        def clear(at: acquiring_modbus.ModbusPlace, value: float) -> None:
            for number, write in enumerate(spec.clear):
                here = (write.table, write.address) == (at.table, at.address)
                if here and value == write.value:
                    watchdog.clear(number, value)

        add(spec.time, on_read=lambda: float(watchdog.steps), on_write=set_time)
        add(spec.tripped, on_read=watchdog.status, writable=False)
        if spec.feed is not None:
            add(spec.feed, on_write=watchdog.fed)
        for write in spec.clear:
            # clearing often means one register and one value after the other
            add(write, on_write=partial(clear, write))

    def _write(self, raw: float) -> None:
        self._refuse_after_trip()
        self._instrument.write_reference(self._output.offset + self._output.scale * raw)
        if self._output.enable is None and not self._instrument.enabled:
            self._instrument.write_enable(on=True)

    def _switch(self, off: int, value: float) -> None:
        on = value != off
        if on:
            self._refuse_after_trip()
        if on != self._instrument.enabled:
            self._instrument.write_enable(on=on)

    def _refuse_after_trip(self) -> None:
        if self.watchdog is not None and self.watchdog.tripped:
            raise ModbusRefusedError(DEVICE_FAILURE)


@dataclass(eq=False)
class ModbusDevice(MemoryDevice):
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

    instrument: SimulatedInstrument
    table: acquiring_modbus.ModbusAcquisition
    _: KW_ONLY
    amperes_per_v: float
    clock: Callable[[], float] = time.monotonic

    def __post_init__(self) -> None:
        self.reply_s = self.table.reply_s
        self.unit = self.table.unit
        self.memory = Memory(self.table.max_read_registers, lenient=self.table.bridge_registers > 0)
        self._refreshed_s = -1.0
        self._asked = False
        self._seen: dict[str, float] = {}
        self._driving: Driving | None = None
        self._build()

    @property
    def watchdog(self) -> DeviceWatchdog | None:
        """Its watchdog, None where it has none."""
        return None if self._driving is None else self._driving.watchdog

    def hears(self, function: int) -> bool:
        """Feed the watchdog."""
        self.tick()
        if self.watchdog is not None:
            self.watchdog.heard(function)
        return True

    def read(self, space: Space, address: int, count: int, connection: int) -> bytes:
        """Return registers or bits; all channels of one request are of one moment."""
        self._asked = True
        return super().read(space, address, count, connection)

    def tick(self) -> None:
        """Let time pass."""
        if self.watchdog is not None:
            self.watchdog.tick()
        self.instrument.catch_up()

    def add(self, place: acquiring_modbus.ModbusPlace, value: float = 0.0, **access: Any) -> Cell:
        """Put a cell where a place of the profile says; `access` is the rest of `Cell`."""
        return self.memory.add(Cell(place_of(self.table, place), value, **access))

    def _build(self) -> None:
        table = self.table
        # no device has anything there
        place = Register("signature", signature_address(table), "u32")
        self.memory.add(Cell(place, float(SIGNATURE), writable=False))
        for channel in table.channels:
            self.add(channel, on_read=partial(self._read, channel), writable=False)
            for word in (channel.status, channel.sign):
                if word is not None:
                    read = partial(self._word, place_of(table, word))
                    self.add(word, on_read=read, writable=False)
        if table.output is not None:
            self._driving = Driving(self, table.output)
        for rule in table.identify:
            self.add(rule, told(rule), writable=False)
        for write in table.init:
            self.add(write)

    def _read(self, channel: acquiring_modbus.ModbusChannel) -> float:
        self._refresh()
        info = input_info(self.table, channel)
        if not info.wrap:
            raw = abs(self._raw(channel)) if channel.sign is not None else self._raw(channel)
            return raw if channel.type.startswith("f") else float(round(raw))
        value = self._seen[channel.role]
        count = int(value) % info.wrap
        signed = channel.type.startswith("i") and count >= info.wrap // 2
        return float(count - info.wrap if signed else count)

    def _raw(self, channel: acquiring_modbus.ModbusChannel) -> float:
        """Return a channel in steps of its register, not rounded, its sign kept."""
        info = input_info(self.table, channel)
        value = min(max(self._seen[channel.role], info.low), info.high)
        return (value - channel.offset) / channel.scale

    def _word(self, place: Register) -> float:
        """Return a word of states: good ones, and the signs of channels that have theirs there."""
        self._refresh()
        word = 0
        for channel in self.table.channels:
            status, sign = channel.status, channel.sign
            if status is not None and place_of(self.table, status) == place:
                word |= status.good
            if sign is not None and place_of(self.table, sign) == place:
                word |= int(self._raw(channel) < 0.0) << sign.bit
        return float(word)

    def _refresh(self) -> None:
        """Take a new reading once a request, no more often than the device renews its values."""
        if not self._asked:
            return
        self._asked = False
        now_s, rate = self.clock(), self.table.refresh_hz
        if rate is not None and self._seen and now_s - self._refreshed_s < 1.0 / rate:
            return
        self._refreshed_s = now_s
        looked = self.instrument.look()
        self._seen = {name: float(volts[-1]) for name, volts in looked.volts.items()}
        self._seen["current"] *= self.amperes_per_v
        self._seen["encoder"] = float(looked.count[-1])


def emulate_modbus(emulation: Emulation, table: acquiring_modbus.ModbusAcquisition) -> ModbusWire:
    """Return a device with the registers of `table` and a simulated bench behind them."""
    device = ModbusDevice(emulation.instrument, table, amperes_per_v=emulation.amperes_per_v)
    return ModbusWire(device, on_line=table.serial is not None)
