"""Acquisition: the stream to scans, missing ones counted and proven by the core timer."""

from __future__ import annotations

import contextlib
import socket
import struct
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.base import WAIT_S, StreamedAcquisition
from hdbench.devices.daq import ScanBlock
from hdbench.devices.wire.address import dial
from hdbench.drivers.labjack.outputs import Outputs
from hdbench.drivers.labjack.registers import error_name
from hdbench.drivers.labjack.scanlist import CORE_TIMER_HZ, ScanPlan, StreamSetup
from hdbench.errors import DeviceError

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
        self._last: Packet | None = None
        self._next = 0

    def feed(self, data: bytes) -> Iterator[Packet]:
        """Take what was received; yield the packets that have become certain, in order."""
        self._data += data
        while len(self._data) >= _HEADER.size:
            length = self._checked_length()
            if self._pending is not None:
                yield self._confirmed(self._pending, int.from_bytes(self._data[:2], "big"))
            end = _HEADER.size + 2 * length
            if len(self._data) < end:
                return
            self._pending = self._packet(bytes(self._data[:end]))
            del self._data[:end]
            if self._pending is not None and self._pending.status in _ENDS:
                # nothing follows it
                yield from self.finish()

    def finish(self) -> Iterator[Packet]:
        """Yield the last packet of a stream that has ended, if it is certain."""
        pending, self._pending = self._pending, None
        if pending is not None and not self._data and not pending.skipped:
            yield pending

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

    def _confirmed(self, pending: Packet, following: int) -> Packet:
        """Return the packet that waits, if the number of the next one agrees."""
        step = (following - pending.number) % _NUMBERS
        if pending.skipped and step != 1:
            raise StreamFault(
                f"packet {pending.number} after {pending.skipped} missing ones is followed by "
                f"packet {following}"
            )
        self._pending = None
        return pending

    def _packet(self, raw: bytes) -> Packet | None:
        number, _, _, _, _, _, _, backlog, status, additional = _HEADER.unpack_from(raw)
        samples = np.frombuffer(raw, dtype=">u2", offset=_HEADER.size).astype(np.uint16)
        skipped = (number - self._next) % _NUMBERS
        if skipped == _NUMBERS - 1 and self._repeats(number, status, samples):
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


# first channel of the scan that the device puts between old and new data after a full buffer; an
# analog input never reads this
_JOINT = 0xFFFF
_WRAP = 2**32
# scan clock and timer come from one oscillator; what is left is when in a scan the timer is read
_TOLERANCE = 0.25


@dataclass(frozen=True, slots=True)
class ScanRun:
    """Adjacent scans."""

    first_index: int
    lost_before: int
    words: NDArray[np.uint16]


class ScanAssembler:
    """Counts scans of one acquisition.

    Scans can be missing because packets are (their numbers tell how many), or because the device's
    buffer was full (it tells how many scans it skipped, and marks the place by a scan whose first
    channel is 0xFFFF). Every scan also carries the device's core timer, 25 ns a tick. Each claimed
    number of missing scans must agree with it, and no two scans may be further apart than claimed;
    anything else is a `StreamFault`. Whether the joint itself counts as skipped is not documented
    for the T series, so the timer decides between the two readings.
    """

    def __init__(self, n_entries: int, timer: int, setup: StreamSetup) -> None:
        self._entries = n_entries
        self._timer = timer
        self._period_ticks = setup.period_s * CORE_TIMER_HZ
        self._per_packet = setup.samples_per_packet // n_entries
        self._index = 0
        self._ticks: int | None = None
        self._claimed: tuple[int, ...] = (0,)

    @property
    def index(self) -> int:
        """Index that the next scan would have if none were missing."""
        return self._index

    def take(self, packet: Packet) -> list[ScanRun]:
        """Return the runs of scans in a packet."""
        entries = self._entries
        scans, rest = divmod(len(packet.samples), entries)
        if rest and packet.status == Status.OK:
            raise StreamFault(f"{len(packet.samples)} samples are no whole scans")
        words = packet.samples[: scans * entries].reshape(scans, entries)
        self._claim(packet.skipped * self._per_packet)
        joints = np.flatnonzero(words[:, 0] == _JOINT)
        if packet.status != Status.RECOVERED:
            if len(joints):
                raise StreamFault("a scan marks a joint, but its packet tells of none")
            return self._run(words)
        if len(joints) != 1:
            raise StreamFault(f"{len(joints)} scans mark the joint after a full buffer; needed: 1")
        before = self._run(words[: joints[0]])
        self._claim(packet.additional, packet.additional - 1)
        return before + self._run(words[joints[0] + 1 :])

    def _claim(self, *numbers: int) -> None:
        """Add missing scans to what is claimed before the next one."""
        self._claimed = tuple(
            old + new for old in self._claimed for new in numbers if old + new >= 0
        )

    def _run(self, words: NDArray[np.uint16]) -> list[ScanRun]:
        """Return adjacent scans as one run; none of no scans."""
        if not len(words):
            return []
        timer = self._timer
        ticks = words[:, timer].astype(np.int64) + (words[:, timer + 1].astype(np.int64) << 16)
        first = int(ticks[0])
        lost = self._lost_before(first)
        errors = _distance(np.diff(ticks), self._period_ticks)
        if np.any(errors > _TOLERANCE * self._period_ticks):
            where = self._index + lost + 1 + int(np.argmax(errors))
            raise StreamFault(
                f"the core timer jumps at scan {where}: scans are missing or mixed up"
            )
        run = ScanRun(self._index + lost, lost, words)
        self._index += lost + len(words)
        self._ticks = int(ticks[-1])
        self._claimed = (0,)
        return [run]

    def _lost_before(self, ticks: int) -> int:
        """Return which of the claimed numbers the timer confirms."""
        period = self._period_ticks
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


_CHUNK = 65536
# statuses that end the stream, and what helps
_ENDS = {
    Status.OVERLAP: "ask for a longer sample period, or fewer channels, or a wider input range",
    Status.RECOVERED_UNCOUNTED: "the network was away for too long: check it, then run again",
    Status.BURST_COMPLETE: "another host has set up this stream: run again",
    Status.BUFFER_FULL: "the network was away longer than the device's buffer lasts: check it",
}
_KNOWN = {Status.OK, Status.RECOVERING, Status.RECOVERED, *_ENDS}


# what is on its way after the stream was stopped, s
_DRAIN_S = 0.1


class Acquisition(StreamedAcquisition):
    """One acquisition of the device, and the socket that its stream comes from."""

    def __init__(self, plan: ScanPlan, setup: StreamSetup, n_samples: int) -> None:
        packet_s = setup.samples_per_packet / len(plan.addresses) * setup.period_s
        super().__init__(n_samples, packet_s)
        self._plan = plan
        self._parser = PacketParser(setup.samples_per_packet)
        self._scans = ScanAssembler(len(plan.addresses), plan.timer, setup)
        self._scan_bytes = 2 * len(plan.addresses)
        self._runs: deque[ScanRun] = deque()
        self._socket: socket.socket | None = None
        self._where = ""
        self._end: DeviceError | None = None
        self._backlog_scans = 0
        self._received_s = (0.0, 0.0)
        self._seen_on = False
        self._drained = False

    def open(self, address: tuple[str, int], timeout_s: float) -> None:
        """Connect to the stream's port."""
        self._where = f"LabJack stream tcp://{address[0]}:{address[1]}"
        try:
            self._socket = dial(address, timeout_s)
        except OSError as error:
            raise self._error(
                f"no connection ({error.strerror or error})",
                "close other programs that read this device's stream",
            ) from error
        self.begin()

    def close(self) -> None:
        """Close the socket; never raises."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.close()

    def next_block(self, outputs: Outputs | None) -> ScanBlock | None:
        """Return the next block; None when no scan has come."""
        if self.complete:
            return self._empty(outputs)
        if self.stopped and not self._drained:
            self._drained = True
            self._finish(_DRAIN_S)
        run = None if self.stopped and not self._runs else self._read(WAIT_S)
        if run is None:
            return self._empty(outputs) if self.stopped else None
        self._hear()
        lost = min(run.lost_before, self._n_samples - self.delivered)
        kept = run.words[: self._n_samples - self.delivered - lost]
        values, saturated, enabled = self._plan.decode(kept)
        self._watch_line(enabled, outputs)
        return self._delivered(
            values,
            saturated,
            self._received_s,
            lost=lost,
            waiting=sum(len(waiting.words) for waiting in self._runs),
            depth=self._backlog_scans,
            tripped=outputs is not None and outputs.tripped,
        )

    def _watch_line(self, enabled: NDArray[np.bool_] | None, outputs: Outputs | None) -> None:
        """Tell a trip from a line that was seen on and then off, while it is ordered on."""
        if outputs is None or enabled is None or not len(enabled):
            return
        if not outputs.ordered_on:
            self._seen_on = False
        elif self._seen_on and not np.all(enabled):
            outputs.note_enabled(on=False)
        else:
            self._seen_on = bool(enabled[-1])

    def _empty(self, outputs: Outputs | None) -> ScanBlock:
        """Return a block without scans: the acquisition is over."""
        nothing = np.zeros((0, len(self._plan.addresses)), dtype=np.uint16)
        values, saturated, _ = self._plan.decode(nothing)
        now_s = time.monotonic()
        tripped = outputs is not None and outputs.tripped
        return self._delivered(values, saturated, (now_s, now_s), tripped=tripped)

    def _read(self, timeout_s: float) -> ScanRun | None:
        """Return the next run of scans, or None when none has come in time."""
        if not self._runs and self._end is None:
            self._receive(timeout_s)
        if self._runs:
            # what came before the end is certain, and is handed out first
            return self._runs.popleft()
        if self._end is not None:
            raise self._end
        return None

    def _finish(self, timeout_s: float) -> None:
        """Take what is still on its way after the stream was stopped."""
        until_s = time.monotonic() + timeout_s
        while self._end is None and time.monotonic() < until_s:
            if not self._receive(max(1e-3, until_s - time.monotonic())):
                break
        if self._end is None:
            self._take(None)

    def _receive(self, timeout_s: float) -> bool:
        """Take bytes that have come; return whether there were any."""
        before_s, broken = time.monotonic(), "the device closed the stream"
        try:
            if self._socket is None:
                return False
            self._socket.settimeout(timeout_s)
            data = self._socket.recv(_CHUNK)
        except TimeoutError:
            return False
        except OSError as error:
            data, broken = b"", f"the stream broke ({error.strerror or error})"
        if not data:
            self._end = self._error(
                f"{broken} after {self._scans.index} scans",
                "it was restarted, or another program took the stream: check both, then run again",
            )
            return False
        self._received_s = (before_s, time.monotonic())
        self._take(data)
        return True

    def _take(self, data: bytes | None) -> None:
        """Take what was received, or None its end; a fault is the end of what can be trusted."""
        try:
            for packet in self._parser.finish() if data is None else self._parser.feed(data):
                if packet.status not in _KNOWN:
                    raise StreamFault(f"status {error_name(packet.status)} is none of a stream")
                self._runs.extend(self._scans.take(packet))
                self._backlog_scans = packet.backlog_bytes // self._scan_bytes
                end = Status(packet.status)
                if end in _ENDS:
                    what = f"the device ended the stream: {error_name(end)}"
                    self._end = self._error(what, _ENDS[end])
                    return
        except StreamFault as fault:
            self._end = self._error(
                f"{fault} (scan {self._scans.index})",
                "scans from there on are in doubt and were not kept: check the network, run again",
            )

    def _error(self, what: str, fix: str) -> DeviceError:
        return DeviceError(what, where=self._where, fix=fix)
