"""Acquisition of an instrument: its stream to blocks, until all samples are there."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.daq import ScanBlock
from hdbench.devices.streamed import WAIT_S, StreamedAcquisition
from hdbench.drivers.dataq.port import Port
from hdbench.drivers.dataq.scans import ScanAssembler, ScanPlan, SignedCounter, StreamFault

# reads whose earliest arrival counts as "now"; clocks of host and device differ by less than this
_WINDOW = 64
_CLOCKS = 2e-4


class LagWatch:
    """Finds whole scans that are missing: those that came fall behind the host's clock."""

    def __init__(self, period_s: float, limit_s: float) -> None:
        self._period_s = period_s
        self._limit_s = limit_s
        self._lags: deque[float] = deque(maxlen=_WINDOW)
        self._least_s: float | None = None
        self._start_s: float | None = None

    def missing(self, delivered: int, read_s: float) -> int:
        """Note that so many scans had come by `read_s`; return how many seem to be missing."""
        if self._start_s is None:
            self._start_s = read_s
        lag_s = read_s - delivered * self._period_s
        self._lags.append(lag_s)
        self._least_s = lag_s if self._least_s is None else min(self._least_s, lag_s)
        behind_s = min(self._lags) - self._least_s
        allowed_s = self._limit_s + _CLOCKS * (read_s - self._start_s)
        return round(behind_s / self._period_s) if behind_s > allowed_s else 0


class Acquisition(StreamedAcquisition):
    """One acquisition of the instrument."""

    def __init__(
        self,
        plan: ScanPlan,
        period_s: float,
        packet_s: float,
        n_samples: int,
        clock: Callable[[], float],
        *,
        encoder: tuple[int, int] | None = None,
    ) -> None:
        super().__init__(n_samples, packet_s, clock)
        self._counter = None if encoder is None else SignedCounter(encoder[0])
        self._tacho = 0 if encoder is None else encoder[1]
        self.period_s = period_s
        self._plan = plan
        self._scans = ScanAssembler(plan)
        # packets have 2**n bytes, scans an odd number of words: the fewest lost packets that are
        # whole scans are as many as the odd part of that number
        odd = len(plan.words)
        while odd % 2 == 0:
            odd //= 2
        self._lag = LagWatch(period_s, max(WAIT_S, (odd - 0.5) * packet_s))
        self._left = b""

    @property
    def overflowed(self) -> bool:
        """Whether the instrument stopped because its buffer ran over."""
        return self._scans.overflowed

    def stop(self, left: bytes) -> None:
        """Note that it was stopped, and what had come by then."""
        self.stopped = True
        self._left = left

    def next_block(self, port: Port) -> ScanBlock | None:
        """Return the next scans; None when none has come."""
        if self.complete:
            return self._block(np.zeros((0, len(self._plan.words)), dtype=np.int16), self._clock())
        if self.stopped:
            left, self._left = self._left, b""
            return self._block(self._scans.take(left), self._clock())
        chunks = port.receive(self._clock() + WAIT_S)
        if not chunks:
            return None
        self._hear()
        scans = self._scans.take(b"".join(data for data, _ in chunks))
        read_s = chunks[-1][1]
        if len(scans) and (missing := self._lag.missing(self._scans.delivered, read_s)):
            raise StreamFault(f"about {missing} scans are missing: they fall behind the clock")
        return self._block(scans, read_s) if len(scans) else None

    def _block(self, words: NDArray[np.int16], read_s: float) -> ScanBlock:
        words = words[: self._n_samples - self.delivered]
        values, saturated = self._plan.decode(words)
        if self._counter is not None and self._plan.counter is not None:
            column = self._plan.counter
            values[:, column] = self._counter(values[:, column], values[:, self._tacho])
        return self._delivered(values, saturated, (read_s, read_s))
