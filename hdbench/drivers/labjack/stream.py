"""Acquisition: the stream to scans, missing ones counted and proven by the core timer."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.daq import ScanBlock
from hdbench.devices.streamed import WAIT_S, StreamedAcquisition
from hdbench.devices.wire import dial
from hdbench.drivers.labjack.outputs import Outputs
from hdbench.drivers.labjack.packets import Packet, PacketParser, Status, StreamFault
from hdbench.drivers.labjack.registers import error_name
from hdbench.drivers.labjack.scanlist import Decoded, ScanLayout, ScanPlan
from hdbench.drivers.labjack.setup import StreamSetup
from hdbench.errors import DeviceError

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

    def __init__(self, layout: ScanLayout, samples_per_packet: int) -> None:
        self._layout = layout
        self._per_packet = samples_per_packet // layout.n_entries
        self._index = 0
        self._ticks: int | None = None
        self._claimed: tuple[int, ...] = (0,)

    @property
    def index(self) -> int:
        """Index that the next scan would have if none were missing."""
        return self._index

    def take(self, packet: Packet) -> list[ScanRun]:
        """Return the runs of scans in a packet."""
        scans, rest = divmod(len(packet.samples), self._layout.n_entries)
        if rest and packet.status == Status.OK:
            raise StreamFault(f"{len(packet.samples)} samples are no whole scans")
        entries = self._layout.n_entries
        words = packet.samples[: scans * entries].reshape(scans, entries)
        self._claim(packet.skipped * self._per_packet)
        joints = np.flatnonzero(words[:, 0] == _JOINT)
        if packet.status != Status.RECOVERED:
            if len(joints):
                raise StreamFault("a scan marks a joint, but its packet tells of none")
            return self._runs([words])
        if len(joints) != 1:
            raise StreamFault(f"{len(joints)} scans mark the joint after a full buffer; needed: 1")
        before = self._runs([words[: joints[0]]])
        self._claim(packet.additional, packet.additional - 1)
        return before + self._runs([words[joints[0] + 1 :]])

    def _claim(self, *numbers: int) -> None:
        """Add missing scans to what is claimed before the next one."""
        self._claimed = tuple(
            old + new for old in self._claimed for new in numbers if old + new >= 0
        )

    def _runs(self, parts: Sequence[NDArray[np.uint16]]) -> list[ScanRun]:
        return [self._run(words) for words in parts if len(words)]

    def _run(self, words: NDArray[np.uint16]) -> ScanRun:
        timer = self._layout.timer
        ticks = words[:, timer].astype(np.int64) + (words[:, timer + 1].astype(np.int64) << 16)
        first = int(ticks[0])
        lost = self._lost_before(first)
        errors = _distance(np.diff(ticks), self._layout.period_ticks)
        if np.any(errors > _TOLERANCE * self._layout.period_ticks):
            where = self._index + lost + 1 + int(np.argmax(errors))
            raise StreamFault(
                f"the core timer jumps at scan {where}: scans are missing or mixed up"
            )
        run = ScanRun(self._index + lost, lost, words)
        self._index += lost + len(words)
        self._ticks = int(ticks[-1])
        self._claimed = (0,)
        return run

    def _lost_before(self, ticks: int) -> int:
        """Return which of the claimed numbers the timer confirms."""
        period = self._layout.period_ticks
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


class Stream:
    """Reads one acquisition."""

    def __init__(
        self,
        address: tuple[str, int],
        layout: ScanLayout,
        samples_per_packet: int,
        *,
        deadline_s: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.where = f"LabJack stream tcp://{address[0]}:{address[1]}"
        self.scans = ScanAssembler(layout, samples_per_packet)
        self.backlog_scans = 0
        self.received_s = (clock(), clock())
        self._scan_bytes = 2 * layout.n_entries
        self._parser = PacketParser(samples_per_packet)
        self._runs: deque[ScanRun] = deque()
        self._clock = clock
        self._end: DeviceError | None = None
        try:
            self._socket = dial(address, deadline_s)
        except OSError as error:
            raise self._error(
                f"no connection ({error.strerror or error})",
                "close other programs that read this device's stream",
            ) from error

    @property
    def duplicates(self) -> int:
        """Packets that came twice and were dropped once."""
        return self._parser.duplicates

    @property
    def waiting(self) -> int:
        """Scans received and not handed out."""
        return sum(len(run.words) for run in self._runs)

    def read(self, timeout_s: float) -> ScanRun | None:
        """Return the next run of scans, or None when none has come in time."""
        if not self._runs and self._end is None:
            self._receive(timeout_s)
        if self._runs:
            # what came before the end is certain, and is handed out first
            return self._runs.popleft()
        if self._end is not None:
            raise self._end
        return None

    def finish(self, timeout_s: float) -> None:
        """Take what is still on its way after the stream was stopped."""
        until_s = self._clock() + timeout_s
        while self._end is None and self._clock() < until_s:
            if not self._receive(max(1e-3, until_s - self._clock())):
                break
        if self._end is None:
            self._guarded(lambda: self._take(self._parser.finish()))

    def close(self) -> None:
        """Close the connection; never raises."""
        with contextlib.suppress(OSError):
            self._socket.close()

    def _receive(self, timeout_s: float) -> bool:
        """Take bytes that have come; return whether there were any."""
        before_s = self._clock()
        try:
            self._socket.settimeout(timeout_s)
            data = self._socket.recv(_CHUNK)
        except TimeoutError:
            return False
        except OSError as error:
            self._end = self._broken(f"the stream broke ({error.strerror or error})")
            return False
        if not data:
            self._end = self._broken("the device closed the stream")
            return False
        self.received_s = (before_s, self._clock())
        self._guarded(lambda: self._feed(data))
        return True

    def _feed(self, data: bytes) -> None:
        self._parser.feed(data)
        self._take(self._parser.packets())

    def _take(self, packets: list[Packet]) -> None:
        for packet in packets:
            if packet.status not in _KNOWN:
                raise StreamFault(f"status {error_name(packet.status)} is none of a stream")
            self._runs.extend(self.scans.take(packet))
            self.backlog_scans = packet.backlog_bytes // self._scan_bytes
            end = Status(packet.status)
            if end in _ENDS:
                what = f"the device ended the stream: {error_name(end)}"
                self._end = self._error(what, _ENDS[end])
                return

    def _guarded(self, act: Callable[[], None]) -> None:
        """Take a fault as the end of what can be trusted."""
        try:
            act()
        except StreamFault as fault:
            self._end = self._error(
                f"{fault} (scan {self.scans.index})",
                "scans from there on are in doubt and were not kept: check the network, run again",
            )

    def _broken(self, what: str) -> DeviceError:
        return self._error(
            f"{what} after {self.scans.index} scans",
            "it was restarted, or another program took the stream: check both, then run again",
        )

    def _error(self, what: str, fix: str) -> DeviceError:
        return DeviceError(what, where=self.where, fix=fix)


# what is on its way after the stream was stopped, s
_DRAIN_S = 0.1


class Acquisition(StreamedAcquisition):
    """One acquisition of the device."""

    def __init__(
        self, plan: ScanPlan, setup: StreamSetup, n_samples: int, clock: Callable[[], float]
    ) -> None:
        packet_s = setup.samples_per_packet / len(plan.addresses) * setup.period_s
        super().__init__(n_samples, packet_s, clock)
        self.samples_per_packet = setup.samples_per_packet
        self.layout = plan.layout(setup.period_s)
        self._plan = plan
        self._stream: Stream | None = None
        self._seen_on = False
        self._drained = False

    def receive_from(self, stream: Stream) -> None:
        """Take the opened stream."""
        self._stream = stream
        self.begin()

    def close(self) -> None:
        """Close the socket; never raises."""
        if self._stream is not None:
            self._stream.close()

    def next_block(self, outputs: Outputs) -> ScanBlock | None:
        """Return the next block; None when no scan has come."""
        stream = self._stream
        if stream is None or self.complete:
            return self._empty(outputs)
        if self.stopped and not self._drained:
            self._drained = True
            stream.finish(_DRAIN_S)
        run = stream.read(WAIT_S) if not (self.stopped and not stream.waiting) else None
        if run is None:
            return self._empty(outputs) if self.stopped else None
        self._hear()
        return self._block(run, stream, outputs)

    def _block(self, run: ScanRun, stream: Stream, outputs: Outputs) -> ScanBlock:
        lost = min(run.lost_before, self._n_samples - self.delivered)
        words = run.words[: self._n_samples - self.delivered - lost]
        decoded = self._plan.decode(words)
        self._watch_line(decoded, outputs)
        return self._delivered(
            decoded.values,
            decoded.saturated,
            stream.received_s,
            lost=lost,
            waiting=stream.waiting,
            depth=stream.backlog_scans,
            tripped=outputs.tripped,
        )

    def _watch_line(self, decoded: Decoded, outputs: Outputs) -> None:
        """Tell a trip from a line that was seen on and then off, while it is ordered on."""
        if decoded.enabled is None or not len(decoded.enabled):
            return
        if not outputs.ordered_on:
            self._seen_on = False
        elif self._seen_on and not np.all(decoded.enabled):
            outputs.note_enabled(on=False)
        else:
            self._seen_on = bool(decoded.enabled[-1])

    def _empty(self, outputs: Outputs) -> ScanBlock:
        """Return a block without scans: the acquisition is over."""
        nothing = self._plan.decode(np.zeros((0, len(self._plan.addresses)), dtype=np.uint16))
        now_s = self._clock()
        return self._delivered(
            nothing.values, nothing.saturated, (now_s, now_s), tripped=outputs.tripped
        )
