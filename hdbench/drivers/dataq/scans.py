"""Bytes of the stream to whole scans; a stream out of step is found, not read on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.drivers.dataq.scanlist import ScanPlan

__all__ = ["ScanAssembler", "StreamFault"]

# what a device whose buffer ran over sends last
OVERFLOW = b"stop 01"


class StreamFault(Exception):  # noqa: N818 - told by the driver as a DeviceError
    """The stream cannot be trusted from here on."""


class ScanAssembler:
    """Cuts a stream into scans and checks the mark of each.

    Parameters
    ----------
    plan : ScanPlan
        Scan list and mark.

    Attributes
    ----------
    delivered : int
        Scans given out so far.

    Notes
    -----
    A scan counts only when its mark is that of the first scan, so the bytes before it are complete:
    a byte too many or too few moves another byte into the mark's place. The digital word cannot be
    mistaken for itself moved by one byte, because its two bytes differ in D1 and D0; moved by whole
    words, an analog word would have to read exactly as the mark does (+9.92 V of 10 V, where the
    inputs are open).
    """

    def __init__(self, plan: ScanPlan) -> None:
        self.delivered = 0
        self._plan = plan
        self._rest = b""
        self._mark: int | None = None

    @property
    def overflowed(self) -> bool:
        """Whether the stream ends as that of a device whose buffer ran over."""
        return self._rest.rstrip(b"\r\n\0").endswith(OVERFLOW)

    @property
    def rest(self) -> bytes:
        """Bytes that are no whole scan yet."""
        return self._rest

    def take(self, data: bytes) -> NDArray[np.int16]:
        """Return the whole scans that `data` completes."""
        self._rest += data
        size = self._plan.scan_bytes
        count = len(self._rest) // size
        raw = np.frombuffer(self._rest, dtype="<i2", count=count * len(self._plan.words))
        scans = raw.reshape(count, len(self._plan.words)).astype(np.int16)
        good = self._good(scans)
        if not good and count:
            raise StreamFault(self._why(scans[0]))
        self._rest = self._rest[good * size :]
        self.delivered += good
        return scans[:good]

    def _good(self, scans: NDArray[np.int16]) -> int:
        """Return how many scans from the first on have the right mark."""
        marker = self._plan.marker
        words = scans.astype(np.int32) & 0xFFFF
        marks = words[:, marker.position] & marker.mask
        if self._mark is None and len(marks) and self._fit(int(words[0, marker.position])):
            self._mark = int(marks[0])
        right = marks == (-1 if self._mark is None else self._mark)
        right &= words[:, marker.position] & marker.zeros == 0
        if marker.position == 0:
            # words that follow the marked one end in zeros down to the resolution
            below = (1 << (16 - self._plan.bits)) - 1
            right &= np.all(words[:, 1:] & below == 0, axis=1)
        return int(np.argmin(right)) if not np.all(right) else len(right)

    def _fit(self, word: int) -> bool:
        """Return whether a word can be the mark of a scan."""
        marker = self._plan.marker
        if word & marker.zeros:
            return False
        if marker.position == 0:
            return word & marker.mask != 0
        return word >> 8 != word & 0xFF

    def _why(self, scan: NDArray[np.int16]) -> str:
        found = int(scan[self._plan.marker.position]) & 0xFFFF
        if self._mark is None:
            return f"the first scan is marked 0x{found:04X}, which no open digital inputs read"
        return (
            f"scan {self.delivered} is marked 0x{found:04X}, the first one 0x{self._mark:04X}: "
            "bytes are missing or too many, or a digital input has changed"
        )
