"""Packets of the stream socket, taken apart and held against what was configured."""

from __future__ import annotations

import struct
from collections import deque
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

_HEADER = struct.Struct(">HHHBBBBHHH")
_FUNCTION, _TYPE, _UNIT = 76, 16, 1
# bytes that the length field counts beside the samples
_FIXED = 10
_NUMBERS = 0x10000


class Status(IntEnum):
    """What a packet says about the stream (``ljm_constants.json``)."""

    OK = 0
    RECOVERING = 2940
    RECOVERED = 2941
    OVERLAP = 2942
    RECOVERED_UNCOUNTED = 2943
    BURST_COMPLETE = 2944
    BUFFER_FULL = 2945


_ENDS = (Status.OVERLAP, Status.RECOVERED_UNCOUNTED, Status.BURST_COMPLETE, Status.BUFFER_FULL)


class StreamFault(Exception):  # noqa: N818 - turned into a DeviceError by the driver
    """Bytes that are no packet of this stream, or packets out of order."""


@dataclass(frozen=True, slots=True)
class Packet:
    """One packet."""

    number: int
    skipped: int
    backlog_bytes: int
    status: int
    additional: int
    samples: NDArray[np.uint16]


class PacketParser:
    """Turns the byte stream of one acquisition into packets that are certain.

    A packet has 16 bytes of header (number, protocol 0, length, unit 1, function 76, type 16,
    reserved, backlog, status, additional) and its samples; it has no checksum. So it is handed out
    only once the header after it was found where it must stand: bytes that went missing or came
    twice within a packet show there. A packet after missing ones waits until the next number
    confirms its own. What this cannot show is a sample whose bits changed on the way past TCP's
    checksum.

    A packet that comes twice is dropped once; one that comes late is a `StreamFault`.
    """

    def __init__(self, n_samples: int) -> None:
        self._n_samples = n_samples
        self._data = bytearray()
        self._pending: Packet | None = None
        self._ready: deque[Packet] = deque()
        self._last: Packet | None = None
        self._next = 0
        self.duplicates = 0

    def feed(self, data: bytes) -> None:
        """Take what was received."""
        self._data += data
        while len(self._data) >= _HEADER.size:
            length = self._checked_length()
            if self._pending is not None:
                self._confirm(int.from_bytes(self._data[:2], "big"))
            end = _HEADER.size + 2 * length
            if len(self._data) < end:
                return
            self._pending = self._packet(bytes(self._data[:end]))
            del self._data[:end]
            if self._pending is not None and self._pending.status in _ENDS:
                # nothing follows it
                self._ready.extend(self.finish())

    def packets(self) -> list[Packet]:
        """Return the packets that have become certain since the last call, in order."""
        ready = list(self._ready)
        self._ready.clear()
        return ready

    def finish(self) -> list[Packet]:
        """Return the last packets of a stream that has ended."""
        pending, self._pending = self._pending, None
        if pending is not None and not self._data and not pending.skipped:
            self._ready.append(pending)
        return self.packets()

    def _checked_length(self) -> int:
        """Return the number of samples of the packet at the front of the data."""
        _, protocol, length, unit, function, kind, _, _, status, _ = _HEADER.unpack_from(self._data)
        if (protocol, unit, function, kind) != (0, _UNIT, _FUNCTION, _TYPE):
            raise StreamFault(
                f"header {self._data[: _HEADER.size].hex(' ')} is none of a stream packet"
            )
        n_samples, odd = divmod(int(length) - _FIXED, 2)
        # a packet that ends the stream may be shorter
        ends = status in _ENDS
        fits = n_samples == self._n_samples or (ends and 0 <= n_samples < self._n_samples)
        if odd or not fits:
            raise StreamFault(f"length {length}; needed: {_FIXED + 2 * self._n_samples}")
        return n_samples

    def _confirm(self, following: int) -> None:
        """Decide about the packet that waits, now that the next header is there."""
        pending = self._pending
        if pending is None:
            return
        step = (following - pending.number) % _NUMBERS
        if pending.skipped and step != 1:
            raise StreamFault(
                f"packet {pending.number} after {pending.skipped} missing ones is followed by "
                f"packet {following}"
            )
        self._pending = None
        self._ready.append(pending)

    def _packet(self, raw: bytes) -> Packet | None:
        number, _, _, _, _, _, _, backlog, status, additional = _HEADER.unpack_from(raw)
        samples = np.frombuffer(raw, dtype=">u2", offset=_HEADER.size).astype(np.uint16)
        skipped = (number - self._next) % _NUMBERS
        if skipped == _NUMBERS - 1 and self._repeats(number, status, samples):
            self.duplicates += 1
            return None
        # more than half of the numbers ahead is behind
        if skipped >= _NUMBERS // 2:
            raise StreamFault(f"packet {number} came late; needed: {self._next}")
        self._next = (number + 1) % _NUMBERS
        packet = Packet(number, skipped, backlog, status, additional, samples)
        self._last = packet
        return packet

    def _repeats(self, number: int, status: int, samples: NDArray[np.uint16]) -> bool:
        last = self._last
        return (
            last is not None
            and (last.number, last.status) == (number, status)
            and np.array_equal(last.samples, samples)
        )
