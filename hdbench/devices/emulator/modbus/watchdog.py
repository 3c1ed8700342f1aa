"""The emulated device's watchdog."""

from __future__ import annotations

from collections.abc import Callable

from hdbench.profile.acquiring_modbus import ModbusIdentify, ModbusWatchdog

__all__ = ["DeviceWatchdog"]

# what a coupler has as its time when it is switched on, s
_FACTORY_S = 1.0


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

    def __init__(
        self, spec: ModbusWatchdog, trip: Callable[[], None], clock: Callable[[], float]
    ) -> None:
        self.tripped = False
        self.steps = round(_FACTORY_S / spec.unit_s)
        self._spec = spec
        self._trip = trip
        self._clock = clock
        self._fed_s: float | None = None
        self._cleared = 0

    def heard(self, function: int) -> None:
        """Note a request that feeds it, where any request or any write does."""
        writes = function in (5, 6, 15, 16)
        if self._spec.fed_by == "message" or (self._spec.fed_by == "write" and writes):
            self._feed()

    def fed(self, value: float) -> None:
        """Note a write to the feeding register."""
        feed = self._spec.feed
        if feed is None or (feed.kind == "key" and value != feed.value):
            return
        self._feed()

    def tick(self) -> None:
        """Trip when the time is over."""
        if self.tripped or self._fed_s is None or not self.steps:
            return
        if self._clock() - self._fed_s > self.steps * self._spec.unit_s:
            self.tripped = True
            self._trip()

    def clear(self, number: int, value: float) -> None:
        """Note a write of the clearing sequence; after the last of them the trip is gone."""
        right = value == self._spec.clear[number].value and number == self._cleared
        self._cleared = number + 1 if right else 0
        if self._cleared == len(self._spec.clear):
            self._cleared, self.tripped, self._fed_s = 0, False, None

    def restart(self) -> None:
        """Wait for a first feeding, as after power came back."""
        self.tripped, self._fed_s, self._cleared = False, None, 0

    def status(self) -> float:
        """Return what its status register reads."""
        rule = self._spec.tripped
        return told(rule) if self.tripped else otherwise(rule)

    def _feed(self) -> None:
        if self.tripped and not self._spec.latches:
            self.tripped = False
        if not self.tripped:
            self._fed_s = self._clock()


def told(rule: ModbusIdentify) -> float:
    """Return a value that keeps a rule."""
    if rule.equals is not None:
        return rule.equals
    return rule.low if rule.low is not None else rule.high or 0.0


def otherwise(rule: ModbusIdentify) -> float:
    """Return a value that breaks a rule."""
    if rule.mask is not None:
        return float(int(told(rule)) ^ rule.mask)
    if rule.equals is not None:
        return 1.0 if rule.equals == 0.0 else 0.0
    return (rule.low or 0.0) - 1.0 if rule.low is not None else (rule.high or 0.0) + 1.0
