"""Lock, position and weights of the emulator, through memory that a real device ignores."""

from __future__ import annotations

from hdbench.devices.labjack.control import Control
from hdbench.devices.labjack.registers import Register, fixture, handling
from hdbench.errors import DeviceError

__all__ = ["EmulatedFixture"]


class EmulatedFixture:
    """Implements `hdbench.devices.daq.Fixture` and `Handling` on the emulator.

    Parameters
    ----------
    control : Control
        The emulator: the driver has checked that it is one.
    """

    def __init__(self, control: Control) -> None:
        self._control = control

    def set_fixture(
        self, *, locked: bool, position_rad: float, mass_kg: float, direction: int
    ) -> None:
        """Write USER_RAM0_F32 to USER_RAM3_F32 and read them back."""
        self._set(fixture(), (float(locked), float(direction), position_rad, mass_kg))

    def set_handling(self, *, swing_rad: float, release_s: float, shunt_ohm: float) -> None:
        """Write USER_RAM4_F32 to USER_RAM6_F32 and read them back."""
        self._set(handling(), (swing_rad, release_s, shunt_ohm))

    def _set(self, registers: tuple[Register, ...], values: tuple[float, ...]) -> None:
        self._control.write(registers, values)
        found = self._control.read_block(registers)
        for register, value, wanted in zip(registers, found, values, strict=True):
            if register.encode(value) != register.encode(wanted):
                raise DeviceError(
                    f"{register.name} reads back as {value:g}; written: {wanted:g}",
                    where=f"{self._control.where}, register {register.describe()}",
                    fix="run again",
                )
