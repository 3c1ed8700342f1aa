"""Acknowledged blocks: order kept, losses counted."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.capabilities import Role
from hdbench.devices.daq import DaqSettings, ScanBlock
from hdbench.devices.node.blockcodec import DATA_AT, HEADER, block_fault
from hdbench.devices.node.codec import Value
from hdbench.devices.node.registers import (
    CHANNELS,
    ENCODER_HIGH,
    ENCODER_LOW,
    Flag,
    block_registers,
    register,
)
from hdbench.devices.wire import FrameError, ReplyCheck, StaleReply, registers_check
from hdbench.errors import DeviceError
from hdbench.records.trace import FloatArray

__all__ = ["BlockReader", "block_check", "channel_bits"]

_CODE_SPAN = 32768
_RUNNING, _TRIPPED = int(Flag.RUNNING), int(Flag.WATCHDOG_TRIPPED)


# half of what 16 bits can tell apart between two scans, and a factor of two to be sure
_SURE_COUNTS = 2.0**14


def channel_bits(
    roles: tuple[Role, ...], sample_period_s: float, limits: Mapping[str, Value]
) -> int:
    """Return the bits of `channels` for the roles of a scan.

    Parameters
    ----------
    roles : tuple of Role
        Channels, in any order.
    sample_period_s : float
        Sampling period, s.
    limits : mapping
        Limits of the node, by register name.

    Returns
    -------
    int
        The encoder's high word is left out where the fastest motor makes less than 2**14 counts
        between two scans: the low word tells them then.
    """
    bits = sum(1 << CHANNELS.index(role) for role in roles if role != "encoder")
    if "encoder" not in roles:
        return bits
    turns = float(limits["limit_velocity_rad_s"]) * sample_period_s / (2.0 * math.pi)
    sure = turns * float(limits["encoder_counts_per_turn"]) < _SURE_COUNTS
    return bits | ENCODER_LOW | (0 if sure else ENCODER_HIGH)


def block_check(count: int, heartbeat: int) -> ReplyCheck:
    """Return a check that lets only the block through that answers this very exchange.

    Parameters
    ----------
    count : int
        Registers asked for.
    heartbeat : int
        Heartbeat written in the same exchange; the block echoes it.

    Returns
    -------
    callable
        Raises `StaleReply` on the answer to another exchange, `FrameError` on a damaged one.
    """
    exact = registers_check(23, count)
    echo = struct.pack(">H", heartbeat)

    def check(pdu: bytes) -> None:
        exact(pdu)
        fault = block_fault(pdu[2:])
        if fault:
            raise FrameError(fault)
        if pdu[2:4] != echo:
            raise StaleReply

    return check


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
        roles = settings.roles
        self._bits = channel_bits(roles, settings.sample_period_s, limits)
        self.stopped = False
        self.ended_early = False
        self.ack = 0
        self.count = block_registers(self._bits.bit_count())
        self._where = where
        self._run = run
        self._n_samples = settings.n_samples
        self._next_index = 0
        # the node sends words in the order of their bits; the encoder's last one stands for it
        words = [CHANNELS[min(bit, 4)] for bit in range(6) if self._bits >> bit & 1]
        order = [len(words) - 1 - words[::-1].index(role) for role in roles]
        self._order = None if order == list(range(len(words))) else order
        amperes = float(limits["current_range_a"]) / _CODE_SPAN
        volts = float(limits["range_v"]) / _CODE_SPAN
        scales = {"current": amperes, "encoder": 1.0}
        self._scales = np.array([scales.get(word, volts) for word in words])
        # codes are left-justified: the top step of a b-bit converter is 2**(16 - b) below 32768
        top_code = 32768 - (1 << (16 - int(limits["converter_bits"])))
        # a counter has no end of range: beyond what 16 bits can be
        coded = np.array([word != "encoder" for word in words])
        self._below_top = np.where(coded, top_code - 1, 32767).astype(np.int16)
        self._above_bottom = np.where(coded, 1 - _CODE_SPAN, -_CODE_SPAN).astype(np.int16)

    def take(self, raw: bytes, read_s: tuple[float, float]) -> ScanBlock | None:
        """Return the block in `raw`, or None when none was ready.

        Once the acquisition is over and all its samples were handed out, an empty block that is not
        `running` is returned. Samples lost at the very end stand before an empty block, too.

        Parameters
        ----------
        raw : bytes
            Registers that passed `block_check`.
        read_s : tuple of float
            Host's clock before the request and after the reply, s.

        Raises
        ------
        DeviceError
            If the block is not the one that comes next.
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
        values, saturated = self._values(raw, n_scans, encoder)
        lost_before = first_index - self._next_index
        self.ack, self._next_index = seq, first_index + n_scans
        return ScanBlock(
            first_index, lost_before, values, saturated, running, tripped, depth, read_s
        )

    def _last(self, tripped: bool, read_s: tuple[float, float]) -> ScanBlock:
        """Return the empty block that says that the acquisition is over."""
        values, saturated = self._values(b"", 0, 0)
        return ScanBlock(self._next_index, 0, values, saturated, False, tripped, 0, read_s)

    def _values(
        self, raw: bytes, n_scans: int, encoder: int
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return values and marks of saturation in the order of the roles."""
        width = len(self._scales)
        wire = np.frombuffer(raw, ">i2", n_scans * width, DATA_AT if n_scans else 0)
        words = wire.reshape(n_scans, width).astype(np.int16)
        values: FloatArray = words * self._scales
        if self._bits & ENCODER_LOW and n_scans:
            values[:, -1] = self._counts(words, encoder)
        saturated = (words > self._below_top) | (words < self._above_bottom)
        if self._order is None:
            return values, saturated
        return values[:, self._order], saturated[:, self._order]

    def _counts(self, words: NDArray[np.int16], encoder: int) -> FloatArray:
        """Return 32-bit counts; from the low words alone by their steps, modulo 2**16."""
        if self._bits & ENCODER_HIGH:
            whole = words[:, -2].astype(np.int64) * 2**16 + words[:, -1].view(np.uint16)
            return whole.astype(np.float64)
        counts = np.empty(len(words))
        counts[0] = encoder
        low = words[:, -1]
        # the difference of 16-bit numbers wraps by itself
        np.subtract(low[1:], low[:-1], out=counts[1:], dtype=np.int16, casting="unsafe")
        total: FloatArray = np.add.accumulate(counts)
        return total

    def _error(self, what: str) -> DeviceError:
        entry = register("block_seq")
        return DeviceError(
            what,
            where=f"{self._where}, register {entry.name} (0x{entry.address:04X})",
            fix="samples of this run are in doubt: check the node, then run again",
        )
