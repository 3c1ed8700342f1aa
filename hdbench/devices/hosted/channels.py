"""Scans of a DAQ as the channels of a bench."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.capabilities import ROLE_UNITS, Capabilities, Role
from hdbench.devices.daq import ScanBlock
from hdbench.devices.ports import Block
from hdbench.records.trace import FloatArray

__all__ = ["ChannelMap", "Unwrap"]

# at the end of its range the amplifier limits the current, not the converter; a count has no end
_CONVERTED: tuple[Role, ...] = ("torque", "tacho", "reference")
References = Callable[[int, int], FloatArray]
"""Gives the reference that stood at n samples from an index on, V."""


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
