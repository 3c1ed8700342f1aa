"""The live view of a run: on a terminal a picture, elsewhere a line every five seconds."""

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

from hdbench.profile import Profile
from hdbench.session.watching import Frame, Watcher
from hdbench_cli.live.history import History
from hdbench_cli.live.picture import picture
from hdbench_cli.output import Output

if TYPE_CHECKING:
    from rich.live import Live


# often enough to look alive, seldom enough to cost the acquisition nothing
_DRAW_S = 0.125
_LINE_S = 5.0
_JOIN_S = 2.0
# frames that wait to be drawn; where there are more, the oldest is dropped
_WAITING = 64


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
        free = float(shutil.disk_usage(place).free)
    except OSError:
        return "unknown"
    for unit in ("B", "kB", "MB", "GB"):
        if free < 1000.0:
            return f"{free:.3g} {unit}"
        free /= 1000.0
    return f"{free:.3g} TB"


@contextmanager
def live_view(title: str, profile: Profile, folder: Path) -> Iterator[Watcher]:
    """Show a run while it goes."""
    view = LiveView(title, profile, folder, pretty=_pretty())
    view.start()
    try:
        yield view
    finally:
        view.stop()


def _pretty() -> bool:

    return sys.stderr.isatty() and os.environ.get("TERM", "") not in ("", "dumb")
