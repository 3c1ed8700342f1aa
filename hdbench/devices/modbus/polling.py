"""One acquisition of a polled device: a reading per period, timed by this computer."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdbench.devices.daq import ScanBlock
from hdbench.devices.modbus.inputs import Inputs

__all__ = ["Polling"]

# longest wait of one call, s
_WAIT_S = 0.02


class Polling:
    """Delivers one reading per period, each with its time.

    Parameters
    ----------
    inputs : Inputs
        What is read.
    n_channels, n_samples : int
        Channels of a reading, and how many are wanted.
    period_s : float
        Sampling period, s.
    clock, sleep : callable
        Monotonic clock in s, and waiting.

    Notes
    -----
    Reading k is due at start + k period. It belongs to the index whose due time is nearest to the
    middle between its request and its reply; an index that none came for is counted as lost, and
    so is one whose reading the device itself calls invalid.
    """

    def __init__(
        self,
        inputs: Inputs,
        n_channels: int,
        n_samples: int,
        period_s: float,
        clock: Callable[[], float],
        sleep: Callable[[float], None],
    ) -> None:
        self.started = False
        self.stopped = False
        self.doubts: dict[str, int] = {}
        self._inputs = inputs
        self._n_channels = n_channels
        self._n_samples = n_samples
        self._period_s = period_s
        self._clock = clock
        self._sleep = sleep
        self._start_s = 0.0
        self._next = 0
        self._untold = 0

    @property
    def sampling(self) -> bool:
        """Whether readings are still to come."""
        return self.started and not self.stopped and self._next < self._n_samples

    def start(self) -> None:
        """Begin: index 0 is due now."""
        self.started = True
        self._start_s = self._clock()

    def stop(self) -> None:
        """Read no more."""
        self.stopped = True

    def next_block(self, *, tripped: bool) -> ScanBlock | None:
        """Return the next reading; None when none is due yet, or it was invalid."""
        if not self.sampling:
            return self._last(tripped=tripped)
        wait_s = self._start_s + self._next * self._period_s - self._clock()
        if wait_s > 0.0:
            self._sleep(min(wait_s, _WAIT_S))
            if wait_s > _WAIT_S:
                return None
        reading = self._inputs.read()
        middle_s = 0.5 * (reading.before_s + reading.after_s)
        index = max(self._next, round((middle_s - self._start_s) / self._period_s))
        if index >= self._n_samples:
            self._untold += self._n_samples - self._next
            self._next = self._n_samples
            return self._last(tripped=tripped)
        lost, self._untold = self._untold + index - self._next, 0
        self._next = index + 1
        if reading.doubt:
            self.doubts[reading.doubt] = self.doubts.get(reading.doubt, 0) + 1
            self._untold = lost + 1
            return None
        return ScanBlock(
            first_index=index,
            lost_before=lost,
            values=np.array([reading.values], dtype=np.float64),
            saturated=np.array([reading.saturated], dtype=bool),
            running=self._next < self._n_samples,
            watchdog_tripped=tripped,
            depth=0,
            read_s=(reading.before_s, reading.after_s),
            time_s=np.array([middle_s]),
        )

    def _last(self, *, tripped: bool) -> ScanBlock:
        """Return an empty block; losses at the end are told with it."""
        lost, self._untold = self._untold, 0
        now_s = self._clock()
        return ScanBlock(
            first_index=self._next,
            lost_before=lost,
            values=np.zeros((0, self._n_channels)),
            saturated=np.zeros((0, self._n_channels), dtype=bool),
            running=False,
            watchdog_tripped=tripped,
            depth=0,
            read_s=(now_s, now_s),
            time_s=np.zeros(0),
        )
