"""Acquisition of a device that streams: scans counted as they are delivered, silence noticed."""

from __future__ import annotations

from collections.abc import Callable

from numpy import bool_
from numpy.typing import NDArray

from hdbench.devices.daq import ScanBlock
from hdbench.records.trace import FloatArray

WAIT_S = 0.02
"""Longest wait of one call for scans, s."""
# beyond three packets' time, silence after which something is wrong, s
_SILENCE_S = 0.5


class StreamedAcquisition:
    """Base of a driver's acquisition: it delivers exactly the scans asked for.

    Parameters
    ----------
    n_samples : int
        Scans to deliver, lost ones counted.
    packet_s : float
        Time in which one packet of the device fills, s.
    clock : callable
        Monotonic clock, s.

    Attributes
    ----------
    delivered : int
        Scans delivered or told as lost.
    started, stopped : bool
        Whether the device was told to start, and to stop.
    """

    def __init__(self, n_samples: int, packet_s: float, clock: Callable[[], float]) -> None:
        self.delivered = 0
        self.started = self.stopped = False
        self._n_samples = n_samples
        self._packet_s = packet_s
        self._clock = clock
        self._heard_s = 0.0

    @property
    def complete(self) -> bool:
        """Whether every scan was delivered or told as lost."""
        return self.delivered >= self._n_samples

    @property
    def sampling(self) -> bool:
        """Whether the device may still be sampling."""
        return self.started and not self.stopped

    @property
    def silent(self) -> bool:
        """Whether nothing has come for longer than packets take."""
        quiet_s = self._clock() - self._heard_s
        return self.sampling and quiet_s > _SILENCE_S + 3.0 * self._packet_s

    def begin(self) -> None:
        """Note that the device was told to start."""
        self.started = True
        self._hear()

    def _hear(self) -> None:
        """Note that something has come."""
        self._heard_s = self._clock()

    def _delivered(
        self,
        values: FloatArray,
        saturated: NDArray[bool_],
        read_s: tuple[float, float],
        *,
        lost: int = 0,
        waiting: int = 0,
        depth: int = 0,
        tripped: bool = False,
    ) -> ScanBlock:
        """Count scans and return their block; `waiting` ones stay behind in this computer."""
        first = self.delivered + lost
        self.delivered = first + len(values)
        return ScanBlock(
            first_index=first,
            lost_before=lost,
            values=values,
            saturated=saturated,
            running=not (self.complete or (self.stopped and not waiting)),
            watchdog_tripped=tripped,
            depth=0 if self.complete else depth + waiting,
            read_s=read_s,
        )
