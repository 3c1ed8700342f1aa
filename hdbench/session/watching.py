"""Frames of a running experiment for a live view; they are dropped rather than waited for."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from hdbench.filter.online import BlockAmplitude
from hdbench.records import FloatArray


@dataclass(frozen=True, slots=True)
class Frame:
    """The newest samples of a run and how it stands."""

    phase: str
    done_s: float
    total_s: float
    columns: Mapping[str, FloatArray]
    rows: int
    lost: int
    saturated: int
    depth: int
    retries: int
    amplitudes: tuple[BlockAmplitude, ...]


class Watcher:
    """Somebody who looks on; this one does not. Neither call may take time or raise."""

    def frame(self, frame: Frame) -> None:
        """Take note of the newest samples."""

    def asking(self, *, now: bool) -> None:
        """Leave the screen to a question (`now`), and take it back after the answer."""


@dataclass(slots=True)
class FrameQueue:
    """Frames between the run and a slower reader; the oldest is dropped when it is full.

    One thread puts, another takes; appending to and taking from a bounded `deque` are atomic.
    Samples are recorded before a frame is made of them: what is dropped here is a picture.
    """

    size: int = 64
    dropped: int = field(default=0, init=False)
    _frames: deque[Frame] = field(init=False)

    def __post_init__(self) -> None:
        self._frames = deque(maxlen=self.size)

    def put(self, frame: Frame) -> None:
        """Add a frame at once, dropping the oldest if need be."""
        if len(self._frames) == self.size:
            self.dropped += 1
        self._frames.append(frame)

    def take(self) -> list[Frame]:
        """Return all frames that wait, oldest first."""
        frames = []
        while self._frames:
            try:
                frames.append(self._frames.popleft())
            except IndexError:  # the one that was there has just been dropped
                break
        return frames
