"""Questions and lines of a calibration, and who answers them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, Protocol

from hdbench.session.calibrating.settling import Judgement


class Answer(Enum):
    """What a person can want."""

    ACCEPT = "accept"
    REPEAT = "repeat"
    BACK = "back"
    SKIP = "skip"
    QUIT = "quit"


Topic = Literal["lock", "place", "hang", "gross-error", "time-out", "check", "last"]


@dataclass(frozen=True, slots=True)
class Question:
    """One question."""

    topic: Topic
    text: str
    answers: tuple[Answer, ...] = tuple(Answer)
    default: Answer = Answer.ACCEPT
    progress: str = ""


@dataclass(frozen=True, slots=True)
class Reply:
    """An answer."""

    answer: Answer
    mass_kg: float | None = None


@dataclass(frozen=True, slots=True)
class LiveReading:
    """What the bridge says while a reading settles, and how long that takes at least."""

    judged: Judgement
    torque_nm: float
    remaining_s: float


class Conversation(Protocol):
    """A person at the bench, or a rule in place of one."""

    @property
    def attended(self) -> bool:
        """Whether a person answers: then a signal interrupts the question."""

    def ask(self, question: Question) -> Reply:
        """Ask, and wait for the answer."""

    def watch(self, live: LiveReading) -> Answer | None:
        """Show how the reading settles; return what was wanted meanwhile, never wait."""

    def tell(self, line: str, *, remarkable: bool = False) -> None:
        """Say one line; `remarkable` ones also where nobody watches."""


# times a rule hangs the right weight before it takes a reading as it is
_TRIES = 3


@dataclass(slots=True)
class Unattended:
    """Answers by rule: hang again after a gross error, take what does not settle, marked.

    Implements `Conversation`.
    """

    say: Callable[[str], None] = lambda _line: None
    attended: bool = field(default=False, init=False)
    _tries: Counter[str] = field(default_factory=Counter, init=False)

    def ask(self, question: Question) -> Reply:
        """Answer by rule."""
        if question.topic != "gross-error":
            return Reply(Answer.ACCEPT)
        self._tries[question.progress] += 1
        again = self._tries[question.progress] < _TRIES
        self.say(f"{question.text} - {'hung again' if again else 'taken as it is, marked'}")
        return Reply(Answer.REPEAT if again else Answer.ACCEPT)

    def watch(self, live: LiveReading) -> Answer | None:
        """Look on."""
        return None

    def tell(self, line: str, *, remarkable: bool = False) -> None:
        """Say only what is remarkable."""
        if remarkable:
            self.say(line)
