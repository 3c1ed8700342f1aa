"""The watchdog that lives in a Modbus device."""

from __future__ import annotations

from hdbench.devices.daq import WatchdogState
from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.layout import Place, place_of
from hdbench.devices.modbus.rules import fits
from hdbench.errors import DeviceError
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusFeed, ModbusWatchdog

__all__ = ["Watchdog"]


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

    def __init__(self, access: Access, table: ModbusAcquisition, spec: ModbusWatchdog) -> None:
        self._access = access
        self._spec = spec
        self._time = place_of(table, spec.time)
        self._tripped = place_of(table, spec.tripped)
        self._clear = [(place_of(table, write), write) for write in spec.clear]
        self._feed: tuple[Place, ModbusFeed] | None = (
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
            raise DeviceError(
                f"the watchdog's time reads back as {found * self._spec.unit_s:g} s; written: "
                f"{wanted * self._spec.unit_s:g} s",
                where=f"{self._access.where}, {self._time.name}",
                fix="without this watchdog nothing may move: compare daq.output.watchdog with the "
                "device's manual",
            )
        self.clear()
        self.feed()
        self._armed = True
        if self.rests():
            raise DeviceError(
                "the watchdog reads as tripped after it was cleared and fed",
                where=f"{self._access.where}, {self._tripped.name}",
                fix="compare daq.output.watchdog.clear and .feed with the device's manual",
            )
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
