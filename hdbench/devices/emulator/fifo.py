"""The node's sample buffer: drops the newest when full, and never closes a gap."""

from __future__ import annotations

from collections import deque

from hdbench.devices.node.blockcodec import SCAN_BYTES

__all__ = ["ScanFifo"]


class ScanFifo:
    """Scans waiting to be read, in runs of adjacent indices.

    Parameters
    ----------
    capacity : int
        Scans that fit.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._runs: deque[tuple[int, bytearray]] = deque()
        self.depth = 0
        self.taken = 0
        self.lost = 0
        self.next_out = 0

    def clear(self) -> None:
        """Forget everything and count from zero."""
        self._runs.clear()
        self.depth = self.taken = self.lost = self.next_out = 0

    def append(self, scans: bytes) -> None:
        """Add new scans; those that do not fit are counted in `lost`."""
        count = len(scans) // SCAN_BYTES
        kept = min(count, self._capacity - self.depth)
        if kept:
            last = self._runs[-1] if self._runs else None
            if last is None or last[0] + len(last[1]) // SCAN_BYTES != self.taken:
                last = (self.taken, bytearray())
                self._runs.append(last)
            last[1].extend(scans[: kept * SCAN_BYTES])
        self.depth += kept
        self.lost += count - kept
        self.taken += count

    def take(self, count: int) -> tuple[int, bytes]:
        """Remove up to `count` adjacent scans."""
        if not self._runs:
            self.next_out = self.taken
            return self.taken, b""
        first, data = self._runs.popleft()
        with memoryview(data) as waiting:
            scans = bytes(waiting[: count * SCAN_BYTES])
        del data[: count * SCAN_BYTES]
        taken = len(scans) // SCAN_BYTES
        if data:
            self._runs.appendleft((first + taken, data))
        self.depth -= taken
        self.next_out = first + taken
        return first, scans
