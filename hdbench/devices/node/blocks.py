"""Blocks of scans: acknowledged, checked, in order, with losses counted."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hdbench.devices.daq import DaqSettings, Role, ScanBlock
from hdbench.devices.node import registers as reg
from hdbench.devices.registers import Value
from hdbench.devices.wire.link import FrameError, ReplyCheck, StaleReply, exchange_registers
from hdbench.errors import DeviceError
from hdbench.records.trace import FloatArray

# echo, run, seq, flags with channels, scans, depth, first index, encoder, checksum
HEADER = struct.Struct(">HHHHHHIiI")
# of these channels, scans and checksum
_SEALED = struct.Struct(">6xBxH10xI")
DATA_AT = 2 * reg.BLOCK_HEADER_REGISTERS
CRC_AT = DATA_AT - 4
_CODE_SPAN = 32768
# half of what 16 bits can tell apart between two scans, and a factor of two to be sure
_SURE_COUNTS = 2.0**14
_WIRE, _WORD, _UNSIGNED = np.dtype(">i2"), np.dtype(np.int16), np.dtype(np.uint16)
_NOTHING = bytes(DATA_AT)
_FEED = struct.Struct(">HH")
_RUNNING, _TRIPPED = int(reg.Flag.RUNNING), int(reg.Flag.WATCHDOG_TRIPPED)


def block_fault(raw: bytes) -> str:
    """Return why the bytes of a block window cannot be what the node sent; empty if they can."""
    if not len(raw) >= DATA_AT:
        return f"{len(raw)} bytes of a block, shorter than a header: its checksum is missing"
    bits, n_scans, told = _SEALED.unpack_from(raw)
    end = DATA_AT + 2 * bits.bit_count() * n_scans
    if not end <= len(raw):
        return f"{end - DATA_AT} bytes of scans in a block of {len(raw) - DATA_AT}"
    if zlib.crc32(raw[DATA_AT:end], zlib.crc32(raw[:CRC_AT])) != told:
        return "the checksum of the block is wrong"
    return ""


def channel_bits(
    roles: tuple[Role, ...], sample_period_s: float, limits: Mapping[str, Value]
) -> int:
    """Return the bits of `channels` for the roles of a scan."""
    bits = sum(1 << reg.CHANNELS.index(role) for role in roles if role != "encoder")
    if "encoder" not in roles:
        return bits
    sure = _most_counts(sample_period_s, limits) < _SURE_COUNTS
    return bits | reg.ENCODER_LOW | (0 if sure else reg.ENCODER_HIGH)


def _most_counts(sample_period_s: float, limits: Mapping[str, Value]) -> float:
    """Return how many counts the fastest motor makes between two scans."""
    turns = float(limits["limit_velocity_rad_s"]) * sample_period_s / (2.0 * math.pi)
    return turns * float(limits["encoder_counts_per_turn"])


class ScanDecoder:
    """Decodes the scans of one acquisition.

    Parameters
    ----------
    roles : tuple of Role
        Channels in the order in which the values are handed out.
    sample_period_s : float
        Sampling period, s.
    limits : mapping
        Limits and scales of the node, by register name.

    Attributes
    ----------
    bits : int
        Words of a scan, as `channel_bits` gives them.

    Notes
    -----
    Scales and bounds are laid out for a whole block, so that each step is one pass of numpy over
    adjacent memory: a block costs some 5 us.
    """

    def __init__(
        self, roles: tuple[Role, ...], sample_period_s: float, limits: Mapping[str, Value]
    ) -> None:
        self.bits = bits = channel_bits(roles, sample_period_s, limits)
        # the node sends words in the order of their bits; the encoder's last one stands for it
        words = [reg.CHANNELS[min(bit, 4)] for bit in range(6) if bits >> bit & 1]
        order = [len(words) - 1 - words[::-1].index(role) for role in roles]
        self._order = None if order == list(range(len(words))) else order
        shape = (reg.block_scans(len(words)), len(words))
        amperes = float(limits["current_range_a"]) / _CODE_SPAN
        volts = float(limits["range_v"]) / _CODE_SPAN
        scales = {"current": amperes, "encoder": 1.0}
        self._scales = _filled([scales.get(word, volts) for word in words], shape, float)
        self._nowhere: NDArray[np.bool_] = np.broadcast_to(np.False_, shape)
        # codes are left-justified, of 8 bits at least: the top step of a b-bit converter is
        # 2**(16 - b) below 32768
        top_code = _CODE_SPAN - (1 << (16 - int(limits["converter_bits"])))
        # a counter has no end of range: beyond what 16 bits can be
        coded = np.array([word != "encoder" for word in words])
        lowest = np.where(coded, 1 - _CODE_SPAN, -_CODE_SPAN)
        highest = np.where(coded, top_code - 1, _CODE_SPAN - 1)
        self._lowest = _filled(lowest, shape, _WORD)
        self._span = _filled(highest - lowest, shape, _UNSIGNED)
        # twice what the fastest motor makes: one that is faster was stopped before
        self._block_counts = 2.0 * _most_counts(sample_period_s, limits) * shape[0]

    def decode(
        self, raw: bytes, n_scans: int, encoder: int
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return values and marks of saturation in the order of the roles."""
        scales, saturated = self._scales, self._nowhere
        if n_scans != len(scales):
            scales, saturated = scales[:n_scans], saturated[:n_scans]
        words = np.ndarray(scales.shape, _WIRE, raw if n_scans else _NOTHING, DATA_AT)
        values: FloatArray = words.astype(float)
        values *= scales
        if self.bits & reg.ENCODER_LOW and n_scans:
            self._count(values, words, encoder)
        # both ends of at least 8 bits begin with one of two bytes: mostly none of them is there
        high = raw[DATA_AT : DATA_AT + words.nbytes : 2]
        if 0x7F in high or 0x80 in high:
            saturated = self._saturated(words)
        if self._order is None:
            return values, saturated
        return values[:, self._order], saturated[:, self._order]

    def _saturated(self, words: NDArray[np.int16]) -> NDArray[np.bool_]:
        """Return where a code is at an end of the range."""
        n_scans = len(words)
        # one comparison for both ends: below the lowest the difference wraps to above the span
        above = np.subtract(words, self._lowest[:n_scans], dtype=_WORD).view(_UNSIGNED)
        marks: NDArray[np.bool_] = above > self._span[:n_scans]
        return marks

    def _count(self, values: FloatArray, words: NDArray[np.int16], encoder: int) -> None:
        """Make 32-bit counts of the last column, which holds the low words."""
        if self.bits & reg.ENCODER_HIGH:
            low = words[:, -1].astype(_WORD).view(_UNSIGNED)
            values[:, -1] = words[:, -2].astype(np.int64) * 2**16 + low
            return
        first = (encoder + _CODE_SPAN) % 2**16 - _CODE_SPAN
        if abs(first) + self._block_counts < _CODE_SPAN and first == words.item(0, -1):
            # no low word of this block can have wrapped
            if first != encoder:
                values[:, -1] += encoder - first
            return
        counts, low = values[:, -1], words[:, -1].astype(_WORD)
        counts[0] = encoder
        # the difference of 16-bit numbers wraps by itself
        counts[1:] = low[1:] - low[:-1]
        np.add.accumulate(counts, out=counts)


def _filled(
    row: Sequence[float] | NDArray[np.int64], shape: tuple[int, int], dtype: DTypeLike
) -> NDArray[Any]:
    """Return an array of equal rows."""
    return np.ascontiguousarray(np.broadcast_to(np.asarray(row).astype(dtype), shape))


class BlockExchange:
    """Builds the exchanges of one window: all but acknowledgement and heartbeat is made once.

    Parameters
    ----------
    count : int
        Registers to read, the header's 12 at least.
    """

    def __init__(self, count: int) -> None:
        window, target = reg.BLOCK[0].address, reg.FEED[0].address
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
        self.window = BlockExchange(reg.block_registers(self._bits.bit_count()))
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
        entry = reg.register("block_seq")
        return DeviceError(
            what,
            where=f"{self._where}, register {entry.name} (0x{entry.address:04X})",
            fix="samples of this run are in doubt: check the node, then run again",
        )
