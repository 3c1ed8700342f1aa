"""The person at the bench, asked on the terminal."""

from __future__ import annotations

import math
from dataclasses import dataclass

import click

__all__ = ["ConsoleOperator"]


@dataclass(frozen=True, slots=True)
class ConsoleOperator:
    """Asks on stderr and waits for an answer.

    Parameters
    ----------
    motion_confirmed : bool
        True where ``--yes`` was given: neither motion nor the free motor is asked for again.
    """

    motion_confirmed: bool = False

    def confirm_lock(self, *, locked: bool) -> bool:
        """Ask for the wave generator to be locked or released."""
        if locked:
            return self._ask("Lock the wave generator with the locking shaft. Locked?")
        return self.motion_confirmed or self._ask(
            "Take the locking shaft off: the motor must turn freely. Free?"
        )

    def set_position(self, position_rad: float, *, index: int, count: int) -> bool:
        """Ask for a flexspline position."""
        degrees = math.degrees(position_rad)
        return self._ask(
            f"Bring the flexspline to position {index} of {count}: {degrees:.1f} degrees. Done?"
        )

    def hang(self, mass_kg: float, *, direction: str, expected_nm: float, step: str) -> bool:
        """Ask for a weight."""
        if mass_kg == 0.0:
            return self._ask(f"{step}: take all weights off ({direction} side). Done?")
        return self._ask(
            f"{step}: hang {mass_kg:g} kg on the {direction} side "
            f"(expect {expected_nm:+.2f} N m). Done?"
        )

    def confirm_motion(self, description: str) -> bool:
        """Ask whether the motor may move."""
        return self.motion_confirmed or self._ask(f"The motor will move: {description}. Go?")

    @staticmethod
    def _ask(question: str) -> bool:
        return click.confirm(question, default=True, err=True)
