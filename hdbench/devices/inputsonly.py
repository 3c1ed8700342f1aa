"""The half of a DAQ that a device without outputs does not have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NoReturn

from hdbench.devices.daq import Role, WatchdogState
from hdbench.devices.ports import Identity, SafeState
from hdbench.errors import DeviceError

__all__ = ["InputsOnly"]


class InputsOnly:
    """Base of drivers whose device drives nothing: all that drives is refused."""

    def identity(self) -> Identity:
        """Return who answers; every driver has its own."""
        raise NotImplementedError

    def claim(self) -> None:
        """Check who answers: a serial port is open for one program only."""
        self.identity()

    def write_output(self, name: str, value: float) -> float:
        """Refuse: there is no analog output."""
        self._refuse()

    def enable(self, *, on: bool) -> bool:
        """Refuse: nothing here enables a drive."""
        self._refuse()

    def arm_watchdog(self, time_s: float) -> float:
        """Refuse: there is no watchdog."""
        self._refuse()

    def feed_watchdog(self) -> None:
        """Refuse: there is no watchdog."""
        self._refuse()

    def watchdog(self) -> WatchdogState:
        """Return that there is none."""
        return WatchdogState(armed=False, tripped=False, time_s=0.0)

    def clear_watchdog(self) -> None:
        """Do nothing: there is none."""

    def snapshot(self) -> Mapping[Role, float]:
        """Return nothing: no reading is needed to see a motor stand."""
        return {}

    def safe_state(self) -> SafeState:
        """Return that nothing moves by this device."""
        return SafeState(True, None, None, "the device drives nothing")

    def _refuse(self) -> NoReturn:
        raise DeviceError(
            "this device has no analog output and no watchdog",
            where=type(self).__name__,
            fix='drive the motor with another device: driver = "composite"',
        )
