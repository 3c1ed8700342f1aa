"""Outputs of a polled device: motor reference, enable line and watchdog, every write read back."""

from __future__ import annotations

from hdbench.devices.base import HostOutputs
from hdbench.devices.daq import WatchdogState
from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.layout import fits, place_of
from hdbench.devices.registers import Register, range_of
from hdbench.devices.transactor import was_answered
from hdbench.profile import acquiring_modbus

# looks at a write whose answer did not come, or said that the device is still working on it
_LOOKS = 5


def output_range_v(output: acquiring_modbus.ModbusOutput) -> tuple[float, float]:
    """Return the range that may be written: that of the register within the profile's limit."""
    ends = sorted(output.offset + output.scale * end for end in range_of(output.type))
    return max(ends[0], -output.limit_v), min(ends[1], output.limit_v)


def output_step_v(output: acquiring_modbus.ModbusOutput) -> float:
    """Return the smallest change that the register shows, V; 0 for a float."""
    return 0.0 if output.type.startswith("f") else abs(output.scale)


class Watchdog:
    """Sets, feeds and reads it.

    Parameters
    ----------
    access : Access
        The device.
    table : ModbusAcquisition
        ``[daq]``.
    spec : ModbusWatchdog
        ``[daq.output.watchdog]``.
    """

    def __init__(
        self,
        access: Access,
        table: acquiring_modbus.ModbusAcquisition,
        spec: acquiring_modbus.ModbusWatchdog,
    ) -> None:
        self._access = access
        self._spec = spec
        self._time = place_of(table, spec.time)
        self._tripped = place_of(table, spec.tripped)
        self._clear = [(place_of(table, write), write) for write in spec.clear]
        self._feed: tuple[Register, acquiring_modbus.ModbusFeed] | None = (
            None if spec.feed is None else (place_of(table, spec.feed), spec.feed)
        )
        self._beats = 0
        self._armed = False

    def arm(self, time_s: float) -> float:
        """Set its time where it differs, clear a trip, feed it, and return its time, s."""
        wanted = round(time_s / self._spec.unit_s)
        if self._access.read([self._time])[0] != wanted:
            self._access.write(self._time, wanted)
        found = self._access.read([self._time])[0]
        if not 0 < found <= wanted:
            raise self._access.error(
                f"the watchdog's time reads back as {found * self._spec.unit_s:g} s; written: "
                f"{wanted * self._spec.unit_s:g} s",
                self._time.name,
                "without this watchdog nothing may move: compare daq.output.watchdog with the "
                "device's manual",
            )
        self.clear()
        self.feed()
        self._armed = True
        if self.rests():
            what = "the watchdog reads as tripped after it was cleared and fed"
            fix = "compare daq.output.watchdog.clear and .feed with the device's manual"
            raise self._access.error(what, self._tripped.name, fix)
        return float(found * self._spec.unit_s)

    def feed(self) -> None:
        """Feed it once."""
        self._beats += 1
        if self._feed is None:
            self._access.read([self._tripped])
            return
        place, feed = self._feed
        value = {
            "key": feed.value,
            "toggle": feed.value if self._beats % 2 else 0,
            "increment": self._beats % 65536,
        }[feed.kind]
        self._access.write(place, value)

    def rests(self) -> bool:
        """Return whether it reads as tripped, armed by this host or not.

        A coupler's watchdog begins to run with the first write and trips while a standing bench is
        measured: it then holds outputs that are zero anyhow.
        """
        return fits(self._spec.tripped, self._access.read([self._tripped])[0])

    def state(self) -> WatchdogState:
        """Return its state as read from the device; a trip counts once this host has armed it."""
        time, tripped = self._access.read([self._time, self._tripped])
        return WatchdogState(
            armed=self._armed and time > 0,
            tripped=self._armed and fits(self._spec.tripped, tripped),
            time_s=float(time * self._spec.unit_s),
        )

    def clear(self) -> None:
        """Disarm, and clear a trip, if there is one, by the writes of the profile."""
        self._armed = False
        if not self.rests():
            return
        for place, write in self._clear:
            self._access.write(place, write.value, write.function)


class Outputs(HostOutputs):
    """Writes the outputs that the profile lists, and nothing else.

    Parameters
    ----------
    access : Access
        The device.
    table : ModbusAcquisition
        ``[daq]``.
    output : ModbusOutput
        ``[daq.output]``.
    """

    def __init__(
        self,
        access: Access,
        table: acquiring_modbus.ModbusAcquisition,
        output: acquiring_modbus.ModbusOutput,
    ) -> None:
        self._place = place_of(table, output)
        # what still counts as zero, V: one step; of a float, less than moves any motor
        super().__init__(
            access.where,
            self._place.name,
            output_range_v(output),
            zero_v=max(output_step_v(output), 1e-6),
            brake_s=output.brake_s,
        )
        self._access = access
        self._output = output
        self._back: Register = (
            self._place if output.read_back is None else place_of(table, output.read_back)
        )
        self._enable = None if output.enable is None else place_of(table, output.enable)
        spec = output.watchdog
        self.watchdog: Watchdog | None = None if spec is None else Watchdog(access, table, spec)

    def zero(self) -> None:
        """Bring the reference to zero, past a watchdog that rests."""
        if self.watchdog is not None and self.watchdog.rests():
            if abs(self.read_back()) <= self.zero_v:
                return
            self.watchdog.clear()
        super().zero()

    def switch_off(self) -> bool:
        """Switch the enable line off and return whether it reads as off."""
        rests = self.watchdog is not None and self.watchdog.rests()
        return (rests and not self.enabled()) or super().switch_off()

    def _put(self, value: float) -> float:
        raw = (value - self._output.offset) / self._output.scale
        place, function = self._place, self._output.function
        answered = was_answered(lambda: self._access.write(place, raw, function))
        # half a step is rounding, another half where the device shows what its converter makes of
        # it; a 32-bit float keeps 6e-8 of its value
        steps = 0.5 if self._output.read_back is None else 1.0
        rounding = 1e-6 * (abs(value) + abs(self._output.scale))
        allowed = steps * output_step_v(self._output) + rounding
        found = self.read_back()
        for _ in range(0 if answered else _LOOKS):
            if abs(found - value) <= allowed:
                break
            # it may have said that it is still working on it
            self._access.pause()
            found = self.read_back()
        if not abs(found - value) <= allowed:
            raise self._access.error(
                f"the reference reads back as {found:.6g} V; written: {value:.6g} V",
                self._back.name,
                "use the emergency stop if the motor turns, then check scale and read_back of "
                "daq.output",
            )
        return found

    def read_back(self) -> float:
        """Return the reference that stands at the output, V."""
        return float(self._output.offset + self._output.scale * self._access.read([self._back])[0])

    def enable(self, *, on: bool) -> bool:
        """Write the enable line once and return what it reads back; False without a line."""
        spec, place = self._output.enable, self._enable
        if spec is None or place is None:
            return False
        value = spec.on if on else spec.off
        was_answered(lambda: self._access.write(place, value))
        return self.enabled()

    def enabled(self) -> bool:
        """Return whether the enable line reads as on; False without a line."""
        spec, place = self._output.enable, self._enable
        if spec is None or place is None:
            return False
        return bool(self._access.read([place])[0] != spec.off)
