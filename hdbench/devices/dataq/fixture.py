"""Lock, position and weights of the emulator, by commands that a real instrument does not know."""

from __future__ import annotations

from hdbench.devices.dataq.commands import Commands

__all__ = ["EmulatedFixture"]


class EmulatedFixture:
    """Implements `hdbench.devices.daq.Fixture` and `Handling` on the emulator.

    Parameters
    ----------
    commands : Commands
        The emulator, not scanning: the driver has checked that it is one.
    """

    def __init__(self, commands: Commands) -> None:
        self._commands = commands

    def set_fixture(
        self, *, locked: bool, position_rad: float, mass_kg: float, direction: int
    ) -> None:
        """Set them; the echo reads them back."""
        self._commands.set(f"fixture {int(locked)} {position_rad!r} {mass_kg!r} {direction}")

    def set_handling(self, *, swing_rad: float, release_s: float, shunt_ohm: float) -> None:
        """Set them; the echo reads them back."""
        self._commands.set(f"handling {swing_rad!r} {release_s!r} {shunt_ohm!r}")
