"""Watchdog of the emulated device, whose settings stand in its memory."""

from __future__ import annotations

from collections.abc import Callable

from hdbench.devices.emulator.memory import DEVICE_FAILURE, Memory
from hdbench.devices.emulator.server import ModbusRefusedError


class RefusedError(ModbusRefusedError):
    """A request that the device answers with an exception."""

    def __init__(self, detail: int, exception: int = DEVICE_FAILURE) -> None:
        super().__init__(exception)
        self.detail = detail


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
        memory.hold_all(_SETTINGS, "u32", on_write=self._set)
        memory.hold_all((value for _, value, _ in _DAC), "f32", on_write=self._set)
        memory.hold(_ENABLE, "u32", on_write=self._enable)
        memory.hold(_CLEAR, "u32", on_write=self._clear, readable=False)

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
