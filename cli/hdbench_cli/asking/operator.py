"""Person at the bench: questions before motion, and who answers at a calibration."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

import click

from hdbench.errors import UsageError
from hdbench.profile import Profile
from hdbench.session.calibrating.conversation import Conversation, Unattended
from hdbench_cli.asking.conversation import Keys, TerminalTalk
from hdbench_cli.output import Output, progress_bar

Who = Literal["auto", "person", "simulated"]


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


def silent(_what: str, _share: float) -> None:
    """Show no progress: the screen belongs to the live view or to the questions."""


@contextmanager
def calibration_talk(
    output: Output,
    who: Who,
    profile: Profile,
    *,
    no_input: bool,
    address: str | None,
    control: str | None,
) -> Iterator[tuple[Conversation, bool, Callable[[str, float], None]]]:
    """Yield who answers, whether a person practises on a simulated bench, and the progress."""
    if who == "person" and no_input:
        raise UsageError(
            "--operator person and --no-input together; needed: one",
            where="--operator",
            fix="leave one of them out",
        )
    simulated = control is not None or (address or profile.data.daq.address) == "embedded"
    if who == "simulated" and not simulated:
        raise UsageError(
            "a simulated operator needs the bench's control channel; found none",
            where="--operator simulated",
            fix="add --control with the address that hdbench emulate prints, or ask a person",
        )
    here = sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()
    rehearse = who == "person" or (who == "auto" and here and not no_input)
    if no_input or who == "simulated" or (simulated and not rehearse):
        with progress_bar("calibration") as progress:
            yield Unattended(output.note), False, progress
        return

    with Keys().opened() as keys:
        talk = TerminalTalk(keys, Output.console(stderr=True), practice=simulated)
        try:
            yield talk, rehearse, silent
        finally:
            talk.close()
