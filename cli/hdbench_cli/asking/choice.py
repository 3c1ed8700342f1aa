"""Who answers at a calibration: a person at this terminal, or a rule."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Literal, Protocol

from hdbench.errors import UsageError
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from hdbench.profile import Profile
    from hdbench.session.calibrating.conversation import Conversation
    from hdbench.session.plans import Plan

__all__ = ["Who", "attendance", "handling_words"]

Who = Literal["auto", "person", "simulated"]


class _Asked(Protocol):
    """What a command was asked for."""

    @property
    def no_input(self) -> bool: ...

    @property
    def address(self) -> str | None: ...

    @property
    def control(self) -> str | None: ...


def handling_words(plan: Plan) -> str:
    """Return how long a calibration takes with the hands of a person."""
    minutes = (plan.duration_s + plan.handling_s) / 60.0
    return (
        f"preset {plan.preset}: {len(plan.points)} points; about {minutes:.0f} min with a person: "
        f"{plan.duration_s / 60.0:.0f} min settling and reading, "
        f"{plan.handling_s / 60.0:.0f} min for weights and mountings (an estimate)"
    )


def _silent(_what: str, _share: float) -> None:
    """Leave the screen to the conversation."""


@contextmanager
def attendance(
    output: Output, who: Who, profile: Profile, asked: _Asked
) -> Iterator[tuple[Conversation, bool, Callable[[str, float], None]]]:
    """Bring who answers, and where progress is told."""
    from hdbench.session.calibrating.conversation import Unattended
    from hdbench_cli.live.progress import progress_bar

    if who == "person" and asked.no_input:
        raise UsageError(
            "--operator person and --no-input together; needed: one",
            where="--operator",
            fix="leave one of them out",
        )
    simulated = asked.control is not None or (
        (asked.address or profile.data.daq.address) == "embedded"
    )
    if who == "simulated" and not simulated:
        raise UsageError(
            "a simulated operator needs the bench's control channel; found none",
            where="--operator simulated",
            fix="add --control with the address that hdbench emulate prints, or ask a person",
        )
    here = sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()
    rehearse = who == "person" or (who == "auto" and here and not asked.no_input)
    rule = asked.no_input or who == "simulated" or (simulated and not rehearse)
    if rule:
        with progress_bar("calibration") as progress:
            yield Unattended(output.note), False, progress
        return
    from hdbench_cli.asking.conversation import TerminalTalk
    from hdbench_cli.asking.keys import Keys

    with Keys().opened() as keys:
        talk = TerminalTalk(keys, Output.console(stderr=True), practice=simulated)
        try:
            yield talk, rehearse, _silent
        finally:
            talk.close()
