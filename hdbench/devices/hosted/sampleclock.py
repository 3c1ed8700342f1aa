"""When the samples of a device were taken, on the host's clock."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

__all__ = ["Alignment", "SampleClock"]

# the earliest arrival of this many blocks follows a drifting device clock
_WINDOW = 64


@dataclass(frozen=True, slots=True)
class Alignment:
    """How well writes of the host and samples of the device are placed on one clock.

    Parameters
    ----------
    samples_s : float
        Half-width of the samples' times, s; a rectangular distribution.
    writes_s : float
        Half-width of a write's time, s, of the slowest write so far.
    """

    samples_s: float
    writes_s: float

    @property
    def standard_uncertainty_s(self) -> float:
        """Standard uncertainty of the time of a written value against a sample, s (GUM 4.3.7)."""
        return math.hypot(self.samples_s, self.writes_s) / math.sqrt(3.0)


class SampleClock:
    """Places sample k at ``offset + k * period`` on the host's monotonic clock.

    Parameters
    ----------
    period_s : float
        Sampling period, s.
    before_s, after_s : float
        Host's clock before and after the call that started the acquisition, s.

    Notes
    -----
    Sample 0 was taken after the start was asked for. Sample k was taken before the reply that
    brought it: every block gives a bound, and the tightest of the last 64 one that follows the
    drift of the device's clock. The offset lies between these two bounds; it is taken in the
    middle, with half of their distance as its doubt (limits of a rectangular distribution).
    """

    def __init__(self, period_s: float, before_s: float, after_s: float) -> None:
        self._period_s = period_s
        self._low_s = before_s
        self._high_s = after_s + period_s
        self._first_bound_s = math.inf
        self._bounds_s: deque[float] = deque(maxlen=_WINDOW)

    @property
    def offset_s(self) -> float:
        """Host time of sample 0, s."""
        return 0.5 * (self._low_s + self._high_s) + self._drift_s

    @property
    def doubt_s(self) -> float:
        """Half of the distance of its bounds, s."""
        return 0.5 * (self._high_s - self._low_s)

    @property
    def _drift_s(self) -> float:
        if len(self._bounds_s) < _WINDOW:
            return 0.0
        return min(self._bounds_s) - self._first_bound_s

    def seen(self, newest: int, read_s: float) -> None:
        """Note that sample `newest` was in a reply that ended at `read_s`."""
        bound_s = read_s - newest * self._period_s
        self._bounds_s.append(bound_s)
        if len(self._bounds_s) < _WINDOW or not math.isfinite(self._first_bound_s):
            self._high_s = max(self._low_s, min(self._high_s, bound_s))
        if len(self._bounds_s) == _WINDOW and not math.isfinite(self._first_bound_s):
            self._first_bound_s = min(self._bounds_s)

    def time_s(self, index: int) -> float:
        """Return the host time of sample `index`, s."""
        return self.offset_s + index * self._period_s
