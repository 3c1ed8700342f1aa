"""Channels of a bench from the scans of a DAQ, and their times on this computer's clock."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.bench import Block
from hdbench.devices.daq import ROLE_UNITS, Capabilities, Role, ScanBlock
from hdbench.records.trace import FloatArray

# at the end of its range the amplifier limits the current, not the converter; a count has no end
_CONVERTED: tuple[Role, ...] = ("torque", "tacho", "reference")
References = Callable[[int, int], FloatArray]
"""Gives the reference that stood at n samples from an index on, V."""
# the earliest arrival of this many blocks follows a drifting device clock
_WINDOW = 64


class Unwrap:
    """Counts without wraps, from block to block.

    Parameters
    ----------
    wrap : int
        Period of the counter, counts; 0 for one that does not wrap.

    Notes
    -----
    Between two samples, lost ones included, the motor makes less than half of a period.
    """

    def __init__(self, wrap: int) -> None:
        self._wrap = wrap
        self._last: int | None = None
        self._total = 0

    def __call__(self, raw: FloatArray) -> NDArray[np.int64]:
        """Return the counts of the next samples."""
        counts = np.asarray(raw, dtype=np.int64)
        if len(counts) == 0 or not self._wrap:
            return counts
        if self._last is None:
            self._last = self._total = int(counts[0])
        half = self._wrap // 2
        steps = (np.diff(counts, prepend=self._last) + half) % self._wrap - half
        total: NDArray[np.int64] = self._total + np.cumsum(steps)
        self._last, self._total = int(counts[-1]), int(total[-1])
        return total


class ChannelMap:
    """Turns the scans of one acquisition into blocks of a bench.

    Parameters
    ----------
    roles : tuple of Role
        Channels of a scan, in order.
    capabilities : Capabilities
        Of the device, for the period of its counter.
    references : callable or None
        What the host wrote, for a device that does not measure the reference itself.
    """

    def __init__(
        self,
        roles: tuple[Role, ...],
        capabilities: Capabilities,
        references: References | None = None,
    ) -> None:
        self._column = {role: index for index, role in enumerate(roles)}
        counter = capabilities.input("encoder")
        self._unwrap = Unwrap(counter.wrap if counter else 0)
        self._references = references
        self._absent = tuple(
            role
            for role in ROLE_UNITS
            if role not in self._column and (role != "reference" or references is None)
        )
        self._converted = [self._column[role] for role in _CONVERTED if role in self._column]

    def block(self, scans: ScanBlock, start_s: float, repeats: int = 0) -> Block:
        """Return the scans as a block; channels that are not sampled are NaN, their counts 0."""
        n = len(scans)
        reference = self._values(scans, "reference")
        if "reference" not in self._column and self._references is not None:
            reference = self._references(scans.first_index, n)
        counts = np.zeros(n, dtype=np.int64)
        if "encoder" in self._column:
            counts = self._unwrap(self._values(scans, "encoder"))
        return Block(
            first_index=scans.first_index,
            lost_before=scans.lost_before,
            torque_v=self._values(scans, "torque"),
            tacho_v=self._values(scans, "tacho"),
            motor_current_a=self._values(scans, "current"),
            reference_v=reference,
            encoder_count=counts,
            saturated=np.any(scans.saturated[:, self._converted], axis=1),
            running=scans.running,
            watchdog_tripped=scans.watchdog_tripped,
            depth=scans.depth,
            time_s=None if scans.time_s is None else scans.time_s - start_s,
            absent=self._absent,
            repeats=repeats,
        )

    def _values(self, scans: ScanBlock, role: Role) -> FloatArray:
        column = self._column.get(role)
        if column is None:
            return np.full(len(scans), np.nan)
        return scans.values[:, column]


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
