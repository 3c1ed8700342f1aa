"""Acquisition of a T4 or T7: runs of scans to blocks, until all samples are there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdbench.devices.daq import ScanBlock
from hdbench.devices.streamed import WAIT_S, StreamedAcquisition
from hdbench.drivers.labjack.outputs import Outputs
from hdbench.drivers.labjack.scanlist import Decoded, ScanPlan
from hdbench.drivers.labjack.setup import StreamSetup
from hdbench.drivers.labjack.stream import ScanRun, Stream

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
