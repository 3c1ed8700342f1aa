"""Frames of a running experiment for a live view; they are dropped rather than waited for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from hdbench.filter.online import BlockAmplitude
from hdbench.records import FloatArray

Progress = Callable[[str, float], None]
"""Called with what is going on and the share done, 0 to 1."""


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
