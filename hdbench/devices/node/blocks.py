"""Acknowledged blocks: order kept, losses counted."""

from __future__ import annotations

import struct
from collections.abc import Mapping

from hdbench.devices.daq import DaqSettings, ScanBlock
from hdbench.devices.node.blockcodec import HEADER, block_fault
from hdbench.devices.node.blockvalues import ScanDecoder
from hdbench.devices.node.codec import Value
from hdbench.devices.node.registers import BLOCK, FEED, Flag, block_registers, register
from hdbench.devices.wire import FrameError, ReplyCheck, StaleReply, exchange_registers
from hdbench.errors import DeviceError

__all__ = ["BlockExchange", "BlockReader"]

_FEED = struct.Struct(">HH")
_RUNNING, _TRIPPED = int(Flag.RUNNING), int(Flag.WATCHDOG_TRIPPED)


class BlockExchange:
    """Builds the exchanges of one window: all but acknowledgement and heartbeat is made once.

    Parameters
    ----------
    count : int
        Registers to read, the header's 12 at least.
    """

    def __init__(self, count: int) -> None:
        window, target = BLOCK[0].address, FEED[0].address
        request, self._exact = exchange_registers(window, count, target, b"\0\0\0\0")
        self._request = request[:-4]
        self._head, self._size = bytes((request[0], 2 * count)), 2 + 2 * count
        self._echo = b""

    def build(self, ack: int, heartbeat: int) -> tuple[bytes, ReplyCheck]:
        """Return a request, and a check that lets only the block through that answers it."""
        feed = _FEED.pack(ack, heartbeat)
        self._echo = feed[2:]
        return self._request + feed, self._check

    def _check(self, pdu: bytes) -> None:
        if len(pdu) != self._size or not pdu.startswith(self._head):
            # says what is wrong with it
            self._exact(pdu)
        fault = block_fault(pdu[2:])
        if fault:
            raise FrameError(fault)
        if pdu[2:4] != self._echo:
            raise StaleReply


class BlockReader:
    """The host's side of one acquisition's block exchange.

    Parameters
    ----------
    limits : mapping
        Limits and scales of the node, by register name.
    settings : DaqSettings
        Channels, period and number of samples asked for.
    run : int
        The node's number of this acquisition.
    where : str
        The node, for messages.

    Attributes
    ----------
    stopped : bool
        Set by the driver once it has stopped the acquisition itself.
    """

    def __init__(
        self, limits: Mapping[str, Value], settings: DaqSettings, *, run: int, where: str
    ) -> None:
        self._decoder = ScanDecoder(settings.roles, settings.sample_period_s, limits)
        self._bits = self._decoder.bits
        self.stopped = False
        self.ended_early = False
        self.ack = 0
        self.count = block_registers(self._bits.bit_count())
        self._where = where
        self._run = run
        self._n_samples = settings.n_samples
        self._next_index = 0

    def take(self, raw: bytes, read_s: tuple[float, float]) -> ScanBlock | None:
        """Return the block in `raw`, or None when none was ready.

        Once the acquisition is over and all its samples were handed out, an empty block that is not
        `running` is returned. Samples lost at the very end stand before an empty block, too.
        """
        _, run, seq, flags, n_scans, depth, first_index, encoder, _ = HEADER.unpack_from(raw)
        if run != self._run:
            raise self._error(
                f"the node was restarted during the acquisition: run {run} after {self._run}; "
                "its samples are gone"
            )
        if flags >> 8 != self._bits:
            raise self._error(f"channels 0x{flags >> 8:02X}; needed: 0x{self._bits:02X}")
        running, tripped = flags & _RUNNING != 0, flags & _TRIPPED != 0
        if seq == 0:
            complete = self._next_index >= self._n_samples
            self.ended_early = not (running or tripped or complete or self.stopped)
            return None if running else self._last(tripped, read_s)
        self.ended_early = False
        if seq != self.ack % 0xFFFF + 1:
            raise self._error(f"block {seq} after block {self.ack}")
        if not self._next_index <= first_index <= self._n_samples - n_scans:
            raise self._error(
                f"first sample {first_index} with {n_scans} scans; needed: from "
                f"{self._next_index}, at most {self._n_samples} in all"
            )
        values, saturated = self._decoder.decode(raw, n_scans, encoder)
        lost_before = first_index - self._next_index
        self.ack, self._next_index = seq, first_index + n_scans
        return ScanBlock(
            first_index, lost_before, values, saturated, running, tripped, depth, read_s
        )

    def _last(self, tripped: bool, read_s: tuple[float, float]) -> ScanBlock:
        """Return the empty block that says that the acquisition is over."""
        values, saturated = self._decoder.decode(b"", 0, 0)
        return ScanBlock(self._next_index, 0, values, saturated, False, tripped, 0, read_s)

    def _error(self, what: str) -> DeviceError:
        entry = register("block_seq")
        return DeviceError(
            what,
            where=f"{self._where}, register {entry.name} (0x{entry.address:04X})",
            fix="samples of this run are in doubt: check the node, then run again",
        )
