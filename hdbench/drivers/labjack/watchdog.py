"""The device's own watchdog: kept in flash, strict, dropping the drive's enable line."""

from __future__ import annotations

import math

from hdbench.drivers.labjack.control import Control
from hdbench.drivers.labjack.registers import DIO_STATE, STRICT_CLEAR, WATCHDOG, Register
from hdbench.drivers.labjack.table import LabJackOutput
from hdbench.errors import DeviceError

__all__ = ["KEY", "Watchdog", "watchdog_settings"]

# what feeds it; any number would do, a streaming reader never writes it by chance
KEY = 0x68640B0E
_ALL_LINES = (1 << 23) - 1
_ENABLE = WATCHDOG[0]


def watchdog_settings(output: LabJackOutput, time_s: float) -> dict[str, float]:
    """Return the watchdog's registers by name."""
    bit = 1 << output.enable_line
    values: dict[str, float] = {
        "ENABLE": 1,
        "ADVANCED": 0,
        "TIMEOUT_S": math.ceil(time_s),
        "STARTUP_DELAY_S": math.ceil(time_s),
        "STRICT_ENABLE": 1,
        "STRICT_KEY": KEY,
        "RESET_ENABLE": 0,
        "DIO_ENABLE": 1,
        "DIO_STATE": 0 if output.enable_high else bit,
        "DIO_DIRECTION": bit,
        "DIO_INHIBIT": _ALL_LINES & ~bit,
        "DAC0_ENABLE": int(output.output == "DAC0"),
        "DAC0": 0.0,
        "DAC1_ENABLE": int(output.output == "DAC1"),
        "DAC1": 0.0,
    }
    return {f"WATCHDOG_{name}_DEFAULT": value for name, value in values.items()}


class Watchdog:
    """The watchdog of one device.

    Parameters
    ----------
    control : Control
        Its registers.
    output : LabJackOutput
        Reference and enable line.

    Attributes
    ----------
    flash_writes : int
        Registers written to flash so far.
    """

    def __init__(self, control: Control, output: LabJackOutput) -> None:
        self.flash_writes = 0
        self._control = control
        self._output = output

    def read(self) -> dict[str, float]:
        """Return its settings by register name."""
        values = self._control.read(*WATCHDOG)
        return {register.name: value for register, value in zip(WATCHDOG, values, strict=True)}

    def arm(self, time_s: float) -> float:
        """Bring it to the wanted settings, writing flash only where they differ, and feed it."""
        wanted = watchdog_settings(self._output, time_s)
        found = self.read()
        if found != wanted:
            self._write(wanted, found)
            found = self.read()
        for register in WATCHDOG:
            if found[register.name] != wanted[register.name]:
                raise DeviceError(
                    f"{register.name} reads back as {found[register.name]:g}; written: "
                    f"{wanted[register.name]:g}",
                    where=f"{self._control.where}, register {register.describe()}",
                    fix="without this watchdog nothing may move: check the device's firmware",
                )
        self.feed()
        return float(found["WATCHDOG_TIMEOUT_S_DEFAULT"])

    def feed(self) -> int:
        """Write its key, and return the levels of all lines from the same transaction."""
        key = ((STRICT_CLEAR, KEY),)
        (levels,) = self._control.feedback(key, (DIO_STATE,), repeatable=True)
        return int(levels)

    def _write(self, wanted: dict[str, float], found: dict[str, float]) -> None:
        """Write what differs: it must be off meanwhile, and goes on last."""
        if found[_ENABLE.name]:
            self._put(_ENABLE, 0)
        for register in WATCHDOG[1:]:
            if found[register.name] != wanted[register.name]:
                self._put(register, wanted[register.name])
        self._put(_ENABLE, wanted[_ENABLE.name])

    def _put(self, register: Register, value: float) -> None:
        self.flash_writes += 1
        self._control.write((register,), (value,))
