"""Person at a calibration, asked on stderr and answering by keys."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from hdbench.errors import DeviceError
from hdbench.session.calibrating.conversation import Answer, LiveReading, Question, Reply
from hdbench.system.keyboard import keyboard

if TYPE_CHECKING:
    from rich.console import Console
    from rich.live import Live

# what `Keys.wait` returns when nobody can answer any more
_END = ""
_ESCAPE = "\x1b"
_STANDARD_INPUT = 0
_KEYS = {
    "\n": None,
    "a": Answer.ACCEPT,
    "y": Answer.ACCEPT,
    "yes": Answer.ACCEPT,
    "r": Answer.REPEAT,
    "b": Answer.BACK,
    "s": Answer.SKIP,
    "q": Answer.QUIT,
    "n": Answer.QUIT,
    "no": Answer.QUIT,
    "\x04": Answer.QUIT,
}
_LETTERS = {
    Answer.ACCEPT: ("a", "accept"),
    Answer.REPEAT: ("r", "repeat"),
    Answer.BACK: ("b", "back to the weight before"),
    Answer.SKIP: ("s", "skip"),
    Answer.QUIT: ("q", "save and quit"),
}
_WORDS: dict[str, dict[Answer, str]] = {
    "lock": {Answer.ACCEPT: "locked"},
    "place": {Answer.ACCEPT: "in place"},
    "hang": {Answer.ACCEPT: "done", Answer.REPEAT: "read the last one again"},
    "gross-error": {Answer.ACCEPT: "keep it, marked", Answer.REPEAT: "put right, read again"},
    "time-out": {Answer.ACCEPT: "keep it, marked", Answer.REPEAT: "wait again"},
    "last": {Answer.ACCEPT: "finish", Answer.REPEAT: "read the last one again"},
}
_PRACTICE = (
    "Practice on the embedded bench: Enter hangs what is asked. With --no-input a simulated "
    "operator does it all."
)
_MASS = re.compile(r"\d{1,3}(?:[.,]\d{0,4})?")  # more than a simulated bench takes ends the run
_DOUBTS = ("gross-error", "time-out")
_DRAW_S = 0.1  # often enough to look alive
_BAR = 10
_LINE_S = 5.0  # without a terminal a line now and then is enough


class Keys:
    """Reads what a person presses.

    Notes
    -----
    On a terminal a key counts as soon as it is pressed, without echo; Ctrl-C stays a signal.
    Elsewhere a line counts: its words, then Enter.
    """

    def __init__(self) -> None:
        self._keyboard = keyboard(_STANDARD_INPUT)
        self.terminal = os.isatty(_STANDARD_INPUT)
        self.single = False
        self._waiting = ""
        self._ended = False

    @contextmanager
    def opened(self) -> Iterator[Keys]:
        """Take single keys from a terminal until the end of the block."""
        self.single = self.terminal and self._keyboard.take_single()
        try:
            yield self
        finally:
            self._keyboard.give_back()
            self.single = False

    def forget(self) -> None:
        """Drop what was typed ahead on a terminal: an answer belongs to the question before it."""
        if self.single:
            self._keyboard.take_single()  # a stop with Ctrl-Z may have changed the terminal
            while self._keyboard.ready(0.0) and not self._ended:
                self._read()
            self._waiting = ""

    def wait(self) -> str:
        """Wait for a key or a line."""
        while True:
            taken = self._take()
            if taken is not None:
                return taken
            if self._ended:
                return _END
            self._read()

    def poll(self) -> str | None:
        """Return the next key or line if there is one, without waiting."""
        if not self._ended and self._keyboard.ready(0.0):
            self._read()
        return self._take()

    def _take(self) -> str | None:
        if not self._waiting:
            return None
        if self.single:
            taken, self._waiting = self._waiting[0], self._waiting[1:]
            return taken
        line, mark, rest = self._waiting.partition("\n")
        if not mark and not self._ended:
            return None
        self._waiting = rest
        return line + "\n"

    def _read(self) -> None:
        raw = self._keyboard.read()
        self._ended = not raw
        text = raw.decode("utf-8", errors="replace").replace("\r", "\n")
        # arrows and function keys come as a sequence behind an escape, in one piece
        self._waiting += text.partition(_ESCAPE)[0] if self.single else text


def live_line(live: LiveReading) -> str:
    """Return how a reading settles, in one line of less than 80 characters."""
    judged = live.judged
    full = round(_BAR * min(1.0, max(0.0, judged.share)))
    bar = "#" * full + "." * (_BAR - full)
    swing = "" if judged.swing is None else f" swing {judged.swing.period_s:.2f} s"
    return (
        f"{judged.value_v:+.4f} V {live.torque_nm:+.3f} N m {1e3 * judged.slope_v_s:+.1f} mV/s "
        f"band {1e3 * judged.spread_v:.1f} mV [{bar}] {max(0.0, live.remaining_s):.1f} s{swing}"
    )


@dataclass(slots=True)
class TerminalTalk:
    """Asks on stderr; implements `hdbench.session.calibrating.conversation.Conversation`.

    Parameters
    ----------
    keys : Keys
        What the person presses.
    console : Console
        Stderr.
    practice : bool
        Whether a mass can be typed in place of the asked one: on a simulated bench.
    clock : callable
        Monotonic clock, s.
    """

    keys: Keys
    console: Console
    practice: bool = False
    clock: Callable[[], float] = time.monotonic
    _live: Live | None = field(default=None, init=False)
    _drawn_s: float = field(default=float("-inf"), init=False)
    _helped: set[str] = field(default_factory=set, init=False)

    @property
    def attended(self) -> bool:
        """True: a person answers."""
        return True

    @property
    def pretty(self) -> bool:
        """Whether a line can be drawn over itself."""
        return self.console.is_terminal and not self.console.is_dumb_terminal

    # -- asking ----------------------------------------------------------------------------------

    def ask(self, question: Question) -> Reply:
        """Ask, and wait for the answer."""
        self.close()
        if self.practice and not self._helped:
            self._say(_PRACTICE)
        place = f"[{question.progress}] " if question.progress else ""
        self._say(place + question.text)
        # the keys of a doubt are told each time: there Enter does not accept
        if question.topic not in self._helped or question.topic in _DOUBTS:
            self._helped.add(question.topic)
            self._say(self._help(question))
        self.keys.forget()
        typed = ""
        self._write("  > ")
        while True:
            key = self.keys.wait()
            if key == _END:
                self._say("")
                raise DeviceError(
                    "standard input has ended before all questions were answered",
                    where="standard input",
                    fix="go on with the run from a terminal: hdbench runs resume",
                )
            if len(key) > 1:
                typed, key = key[:-1].strip(), "\n"
                if typed.lower() in _KEYS:
                    typed, key = "", typed.lower()
            typed, reply = self._press(question, typed, key)
            if reply is not None:
                return reply

    def _press(self, question: Question, typed: str, key: str) -> tuple[str, Reply | None]:
        """Return what is typed so far, and the reply once it is complete."""
        weighs = self.practice and question.topic in ("hang", "gross-error")
        if key == "\n" and typed:
            if weighs and _MASS.fullmatch(typed):
                mass_kg = float(typed.replace(",", "."))
                self._say(" kg hangs" if self.keys.single else f"{mass_kg:g} kg hangs")
                wanted = Answer.ACCEPT if question.topic == "hang" else Answer.REPEAT
                return "", Reply(wanted, mass_kg)
        elif key in ("\x7f", "\b") and typed:
            self._write("\b \b")
            return typed[:-1], None
        elif weighs and key and key in "0123456789.,":
            self._write(key)
            return typed + key, None
        elif key.lower() in _KEYS:
            answer = _KEYS[key.lower()] or question.default
            if answer in question.answers:
                words = _WORDS.get(question.topic, {})
                self._say(words.get(answer, _LETTERS[answer][1]))
                return "", Reply(answer)
        self._say("?" if key == "?" else "no such answer here")
        self._say(self._help(question))
        self._write("  > ")
        return "", None

    def _help(self, question: Question) -> str:
        words = _WORDS.get(question.topic, {})
        told = [f"  Enter: {words.get(question.default, question.default.value)}"]
        for answer in question.answers:
            letter, meaning = _LETTERS[answer]
            if answer is not question.default:
                told.append(f"{letter}: {words.get(answer, meaning)}")
        if self.practice and question.topic in ("hang", "gross-error"):
            told.append("a mass in kg: hang that, for practice")
        return "; ".join(told)

    # -- watching --------------------------------------------------------------------------------

    def watch(self, live: LiveReading) -> Answer | None:
        """Show how the reading settles; return what was wanted meanwhile."""
        now_s = self.clock()
        if self.pretty and now_s - self._drawn_s >= _DRAW_S:
            self._drawn_s = now_s
            self._draw(live_line(live))
        elif not self.pretty and now_s - self._drawn_s >= _LINE_S:
            if self._drawn_s > float("-inf"):
                self._say("  " + live_line(live))
            self._drawn_s = now_s
        if not self.keys.terminal:
            return None  # lines answer questions only: they were written before the reading began
        key = self.keys.poll()
        if key is None:
            return None
        if key == "\n":
            return Answer.ACCEPT
        return _KEYS.get(key.lower())

    def tell(self, line: str, *, remarkable: bool = False) -> None:
        """Say one line."""
        self.close()
        self._say("  " + line)

    def close(self) -> None:
        """Take the live line off the screen."""
        live, self._live = self._live, None
        if live is not None:
            with suppress(OSError):
                live.stop()

    def _draw(self, line: str) -> None:
        from rich.live import Live
        from rich.text import Text

        text = Text("  " + line, no_wrap=True, overflow="crop")
        with suppress(OSError):
            if self._live is None:
                self._live = Live(
                    text,
                    console=self.console,
                    auto_refresh=False,
                    transient=True,
                    redirect_stdout=False,
                    redirect_stderr=False,
                )
                self._live.start()
            self._live.update(text, refresh=True)

    def _say(self, line: str) -> None:
        with suppress(OSError):  # a terminal that is gone hears nothing; the journal has it all
            self.console.print(line, markup=False, soft_wrap=not self.console.is_terminal)

    def _write(self, text: str) -> None:
        with suppress(OSError):
            self.console.print(text, markup=False, end="", soft_wrap=True)
            self.console.file.flush()
