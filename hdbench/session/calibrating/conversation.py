"""Questions and lines of a calibration, and who answers them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, Protocol


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
    """One question.

    Parameters
    ----------
    topic : str
        ``lock``, ``place``, ``hang``; ``gross-error``, ``time-out`` and ``check`` (what was read is
        in doubt); ``last`` (everything is read).
    text : str
        The question.
    answers : tuple of Answer
        What can be answered.
    default : Answer
        What Enter means.
    progress : str
        Place in the sequence, such as ``12 of 145``.
    """

    topic: Topic
    text: str
    answers: tuple[Answer, ...]
    default: Answer = Answer.ACCEPT
    progress: str = ""


@dataclass(frozen=True, slots=True)
class Reply:
    """An answer.

    Parameters
    ----------
    answer : Answer
        What is wanted.
    mass_kg : float or None
        Mass that hangs instead of the asked one; only on a simulated bench, for practice.
    """

    answer: Answer
    mass_kg: float | None = None


@dataclass(frozen=True, slots=True)
class LiveReading:
    """What the bridge says while a reading settles.

    Parameters
    ----------
    label : str
        The point in words.
    value_v, slope_v_s, spread_v : float
        Mean (V), slope (V/s), and largest less smallest value (V) of the last window.
    torque_nm : float
        Torque that the mean stands for, N m.
    share : float
        Steady time that has passed, of what is needed, 0 to 1.
    remaining_s : float
        Steady time still needed, s.
    waited_s, limit_s : float
        Time since the change of load and longest wait, s.
    swing_period_s : float or None
        Period of a swing, s.
    """

    label: str
    value_v: float
    slope_v_s: float
    spread_v: float
    torque_nm: float
    share: float
    remaining_s: float
    waited_s: float
    limit_s: float
    swing_period_s: float | None


class Conversation(Protocol):
    """A person at the bench, or a rule in place of one."""

    @property
    def attended(self) -> bool:
        """Whether a person answers: then a signal interrupts the question."""
        ...

    def ask(self, question: Question) -> Reply:
        """Ask, and wait for the answer."""
        ...

    def watch(self, live: LiveReading) -> Answer | None:
        """Show how the reading settles; return what was wanted meanwhile, never wait."""
        ...

    def tell(self, line: str, *, remarkable: bool = False) -> None:
        """Say one line; `remarkable` ones also where nobody watches."""
        ...


class Hands(Protocol):
    """Who moves things at a simulated bench; at a real one the person does."""

    def mount(self, *, locked: bool, position_rad: float) -> None:
        """Lock or release the wave generator and bring the flexspline to a position."""
        ...

    def put(self, mass_kg: float, *, direction: str, number: int, attempt: int) -> None:
        """Hang a mass with pan and hook, kg; `attempt` counts the loadings of point `number`."""
        ...

    def shunt(self, *, closed: bool) -> bool:
        """Switch the shunt resistor; False where the bench has none."""
        ...

    def history(self) -> list[dict[str, float]]:
        """Return every change so far, for `restore`."""
        ...

    def restore(self, history: list[dict[str, float]], acquisitions: int) -> None:
        """Bring a fresh simulated bench to where another one was left."""
        ...


# times a rule hangs the right weight before it takes a reading as it is
_TRIES = 3


@dataclass(slots=True)
class Unattended:
    """Answers by rule: hang again after a gross error, take what does not settle, marked.

    Implements `Conversation`.

    Parameters
    ----------
    say : callable
        Takes remarkable lines.
    """

    say: Callable[[str], None] = lambda _line: None
    _tries: dict[str, int] = field(default_factory=dict, init=False)

    @property
    def attended(self) -> bool:
        """False: nobody answers."""
        return False

    def ask(self, question: Question) -> Reply:
        """Answer by rule."""
        if question.topic != "gross-error":
            return Reply(Answer.ACCEPT)
        tries = self._tries[question.progress] = self._tries.get(question.progress, 0) + 1
        again = tries < _TRIES
        self.say(f"{question.text} - {'hung again' if again else 'taken as it is, marked'}")
        return Reply(Answer.REPEAT if again else Answer.ACCEPT)

    def watch(self, live: LiveReading) -> Answer | None:
        """Look on."""
        return None

    def tell(self, line: str, *, remarkable: bool = False) -> None:
        """Say only what is remarkable."""
        if remarkable:
            self.say(line)
