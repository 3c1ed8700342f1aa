"""From packets to whole scans, every missing one counted and every count proven by the clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.drivers.labjack.packets import Packet, Status, StreamFault

__all__ = ["CORE_TIMER_HZ", "Run", "ScanAssembler", "ScanLayout"]

# CORE_TIMER counts at half of the 80 MHz core clock (ljm_constants.json)
CORE_TIMER_HZ = 40e6
# first channel of the scan that the device puts between old and new data after a full buffer; an
# analog input never reads this
_JOINT = 0xFFFF
_WRAP = 2**32
# scan clock and timer come from one oscillator; what is left is when in a scan the timer is read
_TOLERANCE = 0.25


@dataclass(frozen=True, slots=True)
class ScanLayout:
    """Where in a scan what stands.

    Parameters
    ----------
    n_entries : int
        Words per scan.
    timer : int
        Position of the core timer's low word; its high word follows.
    period_ticks : float
        Ticks of the core timer per scan.
    """

    n_entries: int
    timer: int
    period_ticks: float


@dataclass(frozen=True, slots=True)
class Run:
    """Adjacent scans.

    Parameters
    ----------
    first_index : int
        Index of the first scan since the start of the stream.
    lost_before : int
        Scans missing before it.
    words : ndarray of uint16, shape (n, n_entries)
        The scans.
    """

    first_index: int
    lost_before: int
    words: NDArray[np.uint16]


class ScanAssembler:
    """Counts scans of one acquisition.

    Parameters
    ----------
    layout : ScanLayout
        Where in a scan what stands.
    samples_per_packet : int
        Samples of a full packet, whole scans.

    Notes
    -----
    Scans can be missing because packets are (their numbers tell how many), or because the device's
    buffer was full (it tells how many scans it skipped, and marks the place by a scan whose first
    channel is 0xFFFF). Every scan also carries the device's core timer, 25 ns a tick. Each claimed
    number of missing scans must agree with it, and no two scans may be further apart than claimed;
    anything else is a `StreamFault`. Whether the joint itself counts as skipped is not documented
    for the T series, so the timer decides between the two readings.
    """

    def __init__(self, layout: ScanLayout, samples_per_packet: int) -> None:
        self._layout = layout
        self._per_packet = samples_per_packet // layout.n_entries
        self._index = 0
        self._ticks: int | None = None
        self._claimed: tuple[int, ...] = (0,)
        self.recovered = 0
        self.skipped_packets = 0

    @property
    def index(self) -> int:
        """Index that the next scan would have if none were missing."""
        return self._index

    def take(self, packet: Packet) -> list[Run]:
        """Return the runs of scans in a packet."""
        scans, rest = divmod(len(packet.samples), self._layout.n_entries)
        if rest and packet.status == Status.OK:
            raise StreamFault(f"{len(packet.samples)} samples are no whole scans")
        entries = self._layout.n_entries
        words = packet.samples[: scans * entries].reshape(scans, entries)
        self.skipped_packets += packet.skipped
        self._claim(packet.skipped * self._per_packet)
        joints = np.flatnonzero(words[:, 0] == _JOINT)
        if packet.status != Status.RECOVERED:
            if len(joints):
                raise StreamFault("a scan marks a joint, but its packet tells of none")
            return self._runs([words])
        if len(joints) != 1:
            raise StreamFault(f"{len(joints)} scans mark the joint after a full buffer; needed: 1")
        before = self._runs([words[: joints[0]]])
        self.recovered += 1
        self._claim(packet.additional, packet.additional - 1)
        return before + self._runs([words[joints[0] + 1 :]])

    def _claim(self, *numbers: int) -> None:
        """Add missing scans to what is claimed before the next one."""
        self._claimed = tuple(
            old + new for old in self._claimed for new in numbers if old + new >= 0
        )

    def _runs(self, parts: Sequence[NDArray[np.uint16]]) -> list[Run]:
        return [self._run(words) for words in parts if len(words)]

    def _run(self, words: NDArray[np.uint16]) -> Run:
        timer = self._layout.timer
        ticks = words[:, timer].astype(np.int64) + (words[:, timer + 1].astype(np.int64) << 16)
        first = int(ticks[0])
        lost = self._lost_before(first)
        errors = _distance(np.diff(ticks), self._layout.period_ticks)
        if np.any(errors > _TOLERANCE * self._layout.period_ticks):
            where = self._index + lost + 1 + int(np.argmax(errors))
            raise StreamFault(
                f"the core timer jumps at scan {where}: scans are missing or mixed up"
            )
        run = Run(self._index + lost, lost, words)
        self._index += lost + len(words)
        self._ticks = int(ticks[-1])
        self._claimed = (0,)
        return run

    def _lost_before(self, ticks: int) -> int:
        """Return which of the claimed numbers the timer confirms."""
        period = self._layout.period_ticks
        if self._ticks is None:
            if self._claimed != (0,):
                raise StreamFault("the first scans are missing: nothing tells how many")
            return 0
        step = np.array([ticks - self._ticks])
        for lost in self._claimed:
            if _distance(step, (lost + 1) * period)[0] <= _TOLERANCE * period:
                return lost
        found = ((ticks - self._ticks) % _WRAP) / period - 1.0
        raise StreamFault(
            f"{found:.2f} scans are missing by the core timer before scan {self._index}, "
            f"{self._claimed[0]} by the stream's own count"
        )


def _distance(steps: NDArray[np.int64], expected: float) -> NDArray[np.float64]:
    """Return how far steps of a wrapping counter are from what is expected, ticks."""
    half = _WRAP / 2.0
    distance: NDArray[np.float64] = np.abs((steps - expected + half) % _WRAP - half)
    return distance
