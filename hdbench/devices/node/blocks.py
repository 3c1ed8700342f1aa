"""Acknowledged blocks: order kept, losses counted, counts unwrapped."""

from __future__ import annotations

import struct
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.node.codec import RawBlock, Value, decode_block
from hdbench.devices.node.registers import BLOCK, Flag, register
from hdbench.devices.ports import Block
from hdbench.errors import DeviceError

__all__ = ["BlockReader"]

_CODE_SPAN = 32768.0


class BlockReader:
    """The host's side of one acquisition's block exchange.

    Parameters
    ----------
    limits : mapping
        Limits and scales of the node, by register name.
    n_samples : int
        Samples asked for.
    where : str
        The node, for messages.

    Attributes
    ----------
    stopped : bool
        Set by the driver once it has stopped the acquisition itself.
    """

    window = BLOCK

    def __init__(self, limits: Mapping[str, Value], n_samples: int, where: str) -> None:
        self.stopped = False
        self.ended_early = False
        self._where = where
        self._n_samples = n_samples
        self._range_v = float(limits["range_v"])
        self._current_range_a = float(limits["current_range_a"])
        # codes are left-justified: the top step of a b-bit converter is 2**(16 - b) below 32768
        self._top_code = 32768 - (1 << (16 - int(limits["converter_bits"])))
        self._ack = 0
        self._heartbeat = 0
        self._next_index = 0
        self._encoder = 0

    def feed(self) -> bytes:
        """Return acknowledgement and a heartbeat that differs from the one before."""
        self._heartbeat = self._heartbeat % 0xFFFF + 1
        return struct.pack(">HH", self._ack, self._heartbeat)

    def take(self, raw: bytes) -> Block | None:
        """Return the block in `raw`, or None when none was ready.

        Once the acquisition is over and all its samples were handed out, an empty block that is not
        `running` is returned. Samples lost at the very end stand before an empty block, too.

        Raises
        ------
        DeviceError
            If the block is not the one that comes next.
        """
        try:
            block = decode_block(raw)
        except ValueError as error:
            raise self._error(str(error)) from error
        running = bool(block.flags & Flag.RUNNING)
        tripped = bool(block.flags & Flag.WATCHDOG_TRIPPED)
        if block.seq == 0:
            complete = self._next_index >= self._n_samples
            self.ended_early = not (running or tripped or complete or self.stopped)
            return None if running else self._last(block)
        self.ended_early = False
        if block.seq != self._ack % 0xFFFF + 1:
            raise self._error(f"block {block.seq} after block {self._ack}")
        if not self._next_index <= block.first_index:
            raise self._error(
                f"first sample {block.first_index}; needed: at least {self._next_index}"
            )
        result = self._block(block)
        self._ack = block.seq
        self._next_index = block.first_index + len(block.codes)
        return result

    def _last(self, block: RawBlock) -> Block:
        """Return the empty block that says that the acquisition is over."""
        codes, encoder = block.codes[:0], block.encoder[:0]
        return self._block(RawBlock(0, block.flags, 0, self._next_index, codes, encoder))

    def _block(self, block: RawBlock) -> Block:
        codes = block.codes.astype(np.float64)
        volts = codes * (self._range_v / _CODE_SPAN)
        # the current is left out: at the end of its range the amplifier limits, not the converter
        measured = codes[:, (0, 1, 3)]
        at_the_end = (measured >= self._top_code) | (measured <= -_CODE_SPAN)
        return Block(
            first_index=block.first_index,
            lost_before=block.first_index - self._next_index,
            torque_v=volts[:, 0],
            tacho_v=volts[:, 1],
            motor_current_a=codes[:, 2] * (self._current_range_a / _CODE_SPAN),
            reference_v=volts[:, 3],
            encoder_count=self._unwrap(block.encoder),
            saturated=np.any(at_the_end, axis=1),
            running=bool(block.flags & Flag.RUNNING),
            watchdog_tripped=bool(block.flags & Flag.WATCHDOG_TRIPPED),
            depth=block.depth,
        )

    def _unwrap(self, encoder: NDArray[np.int32]) -> NDArray[np.int64]:
        """Return counts without wraps: no motor makes 2**31 counts between two samples."""
        raw = np.concatenate(([self._encoder], encoder.astype(np.int64)))
        step = (np.diff(raw) + 2**31) % 2**32 - 2**31
        counts: NDArray[np.int64] = self._encoder + np.cumsum(step)
        if len(counts):
            self._encoder = int(counts[-1])
        return counts

    def _error(self, what: str) -> DeviceError:
        entry = register("block_seq")
        return DeviceError(
            what,
            where=f"{self._where}, register {entry.name} (0x{entry.address:04X})",
            fix="samples of this run are in doubt: check the node, then run again",
        )
