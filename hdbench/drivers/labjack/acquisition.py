"""One acquisition: runs of scans to blocks, until all samples are there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdbench.devices.daq import ScanBlock
from hdbench.drivers.labjack.outputs import Outputs
from hdbench.drivers.labjack.scanlist import Decoded, ScanPlan
from hdbench.drivers.labjack.setup import StreamSetup
from hdbench.drivers.labjack.stream import Run, ScanLayout, Stream

__all__ = ["Acquisition"]

# longest wait of one call, s, and silence after which the device is asked what is wrong
_WAIT_S = 0.02
_SILENCE_S = 0.5
# what is on its way after the stream was stopped, s
_DRAIN_S = 0.1


class Acquisition:
    """Delivers exactly the samples asked for.

    Parameters
    ----------
    plan : ScanPlan
        The scan list.
    setup : StreamSetup
        What the device was set to.
    n_samples : int
        Scans to deliver, lost ones counted.
    clock : callable
        Monotonic clock, s.

    Attributes
    ----------
    delivered : int
        Scans delivered or told as lost.
    stopped : bool
        Whether the device was told to stop.
    """

    def __init__(
        self, plan: ScanPlan, setup: StreamSetup, n_samples: int, clock: Callable[[], float]
    ) -> None:
        self.samples_per_packet = setup.samples_per_packet
        self.delivered = 0
        self.stopped = False
        self._plan = plan
        self._period_s = setup.period_s
        self._n_samples = n_samples
        self._clock = clock
        self._stream: Stream | None = None
        self._heard_s = 0.0
        self._seen_on = False
        self._drained = False

    @property
    def layout(self) -> ScanLayout:
        """Words of a scan."""
        return self._plan.layout(self._period_s)

    @property
    def started(self) -> bool:
        """Whether the stream's socket was opened."""
        return self._stream is not None

    @property
    def complete(self) -> bool:
        """Whether every sample was delivered or told as lost."""
        return self.delivered >= self._n_samples

    @property
    def sampling(self) -> bool:
        """Whether the device may still be sampling."""
        return self.started and not self.stopped

    @property
    def silent(self) -> bool:
        """Whether nothing has come for longer than packets take."""
        packet_s = self.samples_per_packet / len(self._plan.addresses) * self._period_s
        return self.sampling and self._clock() - self._heard_s > _SILENCE_S + 3.0 * packet_s

    def begin(self, stream: Stream) -> None:
        """Take the opened stream."""
        self._stream = stream
        self._heard_s = self._clock()

    def stop(self) -> None:
        """Note that the device was told to stop."""
        self.stopped = True

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
        run = stream.read(_WAIT_S) if not (self.stopped and not stream.waiting) else None
        if run is None:
            return self._empty(outputs) if self.stopped else None
        self._heard_s = self._clock()
        return self._block(run, stream, outputs)

    def _block(self, run: Run, stream: Stream, outputs: Outputs) -> ScanBlock:
        lost = min(run.lost_before, self._n_samples - self.delivered)
        words = run.words[: self._n_samples - self.delivered - lost]
        decoded = self._plan.decode(words)
        self._watch_line(decoded, outputs)
        first = self.delivered + lost
        self.delivered = first + len(words)
        return ScanBlock(
            first_index=first,
            lost_before=lost,
            values=decoded.values,
            saturated=decoded.saturated,
            running=not (self.complete or (self.stopped and not stream.waiting)),
            watchdog_tripped=outputs.tripped,
            depth=0 if self.complete else stream.backlog_scans + stream.waiting,
            read_s=stream.received_s,
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
        nothing = self._plan.decode(np.zeros((0, len(self._plan.addresses)), dtype=np.uint16))
        now_s = self._clock()
        return ScanBlock(
            first_index=self.delivered,
            lost_before=0,
            values=nothing.values,
            saturated=nothing.saturated,
            running=False,
            watchdog_tripped=outputs.tripped,
            depth=0,
            read_s=(now_s, now_s),
        )
