"""Live view of a run: on a terminal a picture, elsewhere a line every five seconds."""

from __future__ import annotations

import math
import os
import shutil
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rich.columns import Columns
from rich.console import Group, RenderableType
from rich.filesize import decimal
from rich.text import Text

from hdbench.profile import Profile
from hdbench.session.recorder import Frame, Watcher
from hdbench_cli.live.history import CURVES, Curve, History, Order
from hdbench_cli.output import Output
from hdbench_cli.text import sparkline

if TYPE_CHECKING:
    from rich.live import Live

# often enough to look alive, seldom enough to cost the acquisition nothing
_DRAW_S = 0.125
_LINE_S = 5.0
_JOIN_S = 2.0
# frames that wait to be drawn; where there are more, the oldest is dropped
_WAITING = 64
_LABEL, _NUMBER, _LIMIT = 9, 18, 12
# a screen of fewer columns has no place for the word beside the share of a limit
_NARROW, _NARROW_LIMIT = 56, 6
# beyond four fifths of a limit a person should look
_NEAR = 0.8
# an amplitude has settled once it moved by less than a twentieth of itself for two seconds
_SETTLED = 0.05
_MOST_ORDERS = 8


@dataclass(slots=True)
class LiveView(Watcher):
    """Draws what a run tells, in a thread of its own.

    Parameters
    ----------
    title : str
        Kind of the run.
    profile : Profile
        Limits and scales.
    folder : Path
        Where the run is kept, for the space that is left.
    pretty : bool
        A picture on a terminal; else plain lines.
    clock : callable
        Monotonic clock, s.

    Notes
    -----
    The run only puts frames into a bounded queue: a slow terminal loses pictures, never samples.
    """

    title: str
    profile: Profile
    folder: Path
    pretty: bool
    clock: Callable[[], float] = time.monotonic
    queue: deque[Frame] = field(default_factory=partial(deque, maxlen=_WAITING), init=False)
    _history: History = field(init=False)
    _stop: threading.Event = field(default_factory=threading.Event, init=False)
    _quiet: threading.Event = field(default_factory=threading.Event, init=False)
    _free: threading.Lock = field(default_factory=threading.Lock, init=False)
    _thread: threading.Thread | None = field(default=None, init=False)
    _live: Live | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self._history = History(self.profile.data.servo.velocity_gain_rad_s_per_v, self.clock)

    # -- what the run calls -----------------------------------------------------------------------

    def frame(self, frame: Frame) -> None:
        """Take note of the newest samples; returns at once."""
        self.queue.append(frame)

    def asking(self, *, now: bool) -> None:
        """Leave the screen to a question, and take it back after the answer."""
        if not now:
            self._quiet.clear()
            return
        self._quiet.set()
        with self._free:
            self._close()

    # -- the thread -------------------------------------------------------------------------------

    def start(self) -> None:
        """Start to draw."""
        self._thread = threading.Thread(target=self._run, name="live view", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop and leave the screen as it was."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(_JOIN_S)
        with self._free:
            self._close()

    def _run(self) -> None:
        told_s = self.clock()
        while not self._stop.wait(_DRAW_S):
            self._history.add([self.queue.popleft() for _ in range(len(self.queue))])
            if self._history.last is None or self._quiet.is_set():
                continue
            if self.pretty:
                with self._free:
                    if not (self._quiet.is_set() or self._stop.is_set()):
                        self._draw()
            elif self.clock() - told_s >= _LINE_S:
                told_s = self.clock()
                Output.console(stderr=True).print(self._line(), soft_wrap=True, markup=False)

    def _draw(self) -> None:
        from rich.live import Live

        if self._live is None:
            console = Output.console(stderr=True)
            self._live = Live(console=console, auto_refresh=False, transient=True)
            self._live.start()
        console = self._live.console
        words = (self._heading(), free_space(self.folder))
        drawn = picture(self._history, self.profile, words, console.width)
        self._live.update(drawn, refresh=True)

    def _close(self) -> None:
        live, self._live = self._live, None
        if live is not None:
            # a terminal that was closed meanwhile must not change how the run ends
            with suppress(OSError):
                live.stop()

    def _heading(self) -> str:
        last = self._history.last
        return f"{self.title} on {self.profile.name}: {last.phase if last else 'waiting'}"

    def _line(self) -> str:
        last = self._history.last
        if last is None:
            return f"{self.title}: waiting"
        eta = self._history.eta_s()
        left = f", {eta:.0f} s left" if math.isfinite(eta) else ""
        whole = f" of {last.total_s:.0f}" if math.isfinite(last.total_s) else ""
        counts = f"{last.lost} lost, {last.saturated} saturated, {last.retries} retries"
        return (
            f"{self.title}: {last.done_s:.0f}{whole} s{left}; {last.rows} samples, {counts}; "
            f"{free_space(self.folder)} free"
        )


def free_space(folder: Path) -> str:
    """Return the space that is left where a run is kept, with its unit."""
    place = folder.resolve()
    while not place.exists() and place != place.parent:
        place = place.parent
    try:
        free = shutil.disk_usage(place).free
    except OSError:
        return "unknown"
    return decimal(free)


@contextmanager
def live_view(title: str, profile: Profile, folder: Path) -> Iterator[Watcher]:
    """Show a run while it goes."""
    pretty = sys.stderr.isatty() and os.environ.get("TERM", "") not in ("", "dumb")
    view = LiveView(title, profile, folder, pretty=pretty)
    view.start()
    try:
        yield view
    finally:
        view.stop()


def picture(history: History, profile: Profile, words: tuple[str, str], width: int) -> Group:
    """Return everything to be seen at this moment."""
    room = max(40, min(width, 140)) - 1
    heading, free = words
    lines: list[RenderableType] = [Text(heading[:room], style="bold"), _bar(history, room)]
    lines += [*_counts(history, free), Text()]
    lines += [_curve(history, curve, profile, room) for curve in CURVES]
    orders = history.orders()[:_MOST_ORDERS]
    if orders:
        lines.append(Text())
        scale = history.largest_amplitude_nm
        lines += [_order(found, scale, room) for found in orders]
    return Group(*lines)


def _plain() -> bool:
    # while a live display runs, stderr is a stand-in that names no encoding of its own
    stream = getattr(sys.stderr, "rich_proxied_file", sys.stderr)
    encoding = (stream.encoding or "").lower()
    return "utf" not in encoding or os.environ.get("TERM", "") in ("", "dumb")


def _bar(history: History, room: int) -> Text:
    last = history.last
    if last is None or not math.isfinite(last.total_s) or last.total_s <= 0.0:
        done = 0.0 if last is None else last.done_s
        return Text(f"{done:.0f} s so far; Ctrl-C ends it")
    eta = history.eta_s()
    left = f"  {eta:.0f} s left" if math.isfinite(eta) else ""
    tail = f" {last.done_s:.0f} of {last.total_s:.0f} s{left}"
    wide = max(5, room - len(tail))
    full = round(wide * min(1.0, last.done_s / last.total_s))
    on, off = ("#", "-") if _plain() else ("━", "─")
    return Text.assemble((on * full, "green"), (off * (wide - full), "dim"), tail)


def _counts(history: History, free: str) -> list[Columns]:
    """Return what is counted, on as many lines as it takes."""
    last = history.last
    if last is None:
        return []
    rate = history.rate_hz()
    parts = (
        (f"{rate:.0f} samples/s" if math.isfinite(rate) else "- samples/s", ""),
        (f"lost {last.lost}", "bold red" if last.lost else "green"),
        (f"saturated {last.saturated}", "bold red" if last.saturated else "green"),
        (f"retries {last.retries}", "yellow" if last.retries else "green"),
        (f"waiting {last.depth}", ""),
        (f"disk {free}", ""),
    )
    return [Columns([Text(words, style, no_wrap=True) for words, style in parts], padding=(0, 2))]


def _curve(history: History, curve: Curve, profile: Profile, room: int) -> Text:
    narrow = room < _NARROW
    wide = max(5, room - _LABEL - _NUMBER - (_NARROW_LIMIT if narrow else _LIMIT) - 2)
    points = history.curve(curve, wide)
    same = [history.curve(c, wide) for c in CURVES if c.scale == curve.scale]
    values = [float(v) for part in same for v in part if math.isfinite(v)]
    low, high = (min(values), max(values)) if values else (0.0, 0.0)
    # a constant is drawn in the middle, not stretched to its own noise
    least = 0.02 * max(abs(low), abs(high), 1e-9)
    if high - low < least:
        low, high = low - least, high + least
    drawn = sparkline([float(v) for v in points], wide, (low, high), plain=_plain())
    # full blocks of two lines grow together
    drawn = drawn.replace("█", "▇")
    value = history.newest(curve)
    number = f"{value:+.3f} {curve.unit}" if math.isfinite(value) else f"- {curve.unit}"
    text = Text(f"{curve.label:{_LABEL}}{number:>{_NUMBER - 2}}  ")
    text.append(f"{drawn:{wide}}", style="cyan")
    limit = _limit(curve, profile)
    largest = history.largest(curve.column)
    if limit is not None and math.isfinite(largest):
        share = largest / limit
        style = "bold red" if share > 1.0 else "yellow" if share > _NEAR else "green"
        words = f" {100.0 * share:3.0f} %" if narrow else f" {100.0 * share:4.0f} % limit"
        text.append(words, style=style)
    return text


def _limit(curve: Curve, profile: Profile) -> float | None:
    limits = profile.data.limits
    return {
        "motor_velocity_rad_s": limits.velocity_rad_s,
        "torque_nm": limits.torque_nm,
        "motor_current_a": limits.current_a,
    }.get(curve.column)


def _order(found: Order, scale: float, room: int) -> Text:
    spread = f" +- {found.spread_nm:.3f}" if math.isfinite(found.spread_nm) else ""
    number = f"{found.amplitude_nm:.3f}{spread} N m"
    wide = max(8, room - _LABEL - 3 - len(number) - 2)
    full = round(wide * min(1.0, found.amplitude_nm / scale if scale > 0.0 else 0.0))
    settled = found.spread_nm <= _SETTLED * found.amplitude_nm
    on, off = ("#", ".") if _plain() else ("▇", "▁")
    text = Text(f"{found.name:{_LABEL + 3}}")
    text.append(on * full, style="green" if settled else "yellow")
    text.append(off * (wide - full), style="dim")
    text.append(f"  {number}")
    return text
