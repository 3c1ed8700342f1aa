"""The stream socket of one acquisition: bytes to certain, counted scans."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable

from hdbench.devices.wire import dial
from hdbench.drivers.labjack.errornames import error_name
from hdbench.drivers.labjack.packets import Packet, PacketParser, Status, StreamFault
from hdbench.drivers.labjack.scans import Run, ScanAssembler, ScanLayout
from hdbench.errors import DeviceError

__all__ = ["Stream"]

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
    """Reads one acquisition.

    Parameters
    ----------
    address : tuple of str and int
        Host and port of the stream.
    layout : ScanLayout
        Words of a scan.
    samples_per_packet : int
        Samples of a full packet.
    deadline_s : float
        Longest wait for the connection, s.
    clock : callable, optional
        Monotonic clock, s.

    Raises
    ------
    DeviceError
        If nobody listens.
    """

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
        self._runs: deque[Run] = deque()
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

    def read(self, timeout_s: float) -> Run | None:
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
