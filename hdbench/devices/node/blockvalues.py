"""Scans of a block to values: volts, amperes, counts, and marks of saturation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from hdbench.devices.capabilities import Role
from hdbench.devices.node.blockcodec import DATA_AT
from hdbench.devices.node.codec import Value
from hdbench.devices.node.registers import CHANNELS, ENCODER_HIGH, ENCODER_LOW, block_scans
from hdbench.records.trace import FloatArray

__all__ = ["ScanDecoder", "channel_bits"]

_CODE_SPAN = 32768
# half of what 16 bits can tell apart between two scans, and a factor of two to be sure
_SURE_COUNTS = 2.0**14
_WIRE, _WORD, _UNSIGNED = np.dtype(">i2"), np.dtype(np.int16), np.dtype(np.uint16)
_NOTHING = bytes(DATA_AT)


def channel_bits(
    roles: tuple[Role, ...], sample_period_s: float, limits: Mapping[str, Value]
) -> int:
    """Return the bits of `channels` for the roles of a scan."""
    bits = sum(1 << CHANNELS.index(role) for role in roles if role != "encoder")
    if "encoder" not in roles:
        return bits
    sure = _most_counts(sample_period_s, limits) < _SURE_COUNTS
    return bits | ENCODER_LOW | (0 if sure else ENCODER_HIGH)


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
        words = [CHANNELS[min(bit, 4)] for bit in range(6) if bits >> bit & 1]
        order = [len(words) - 1 - words[::-1].index(role) for role in roles]
        self._order = None if order == list(range(len(words))) else order
        shape = (block_scans(len(words)), len(words))
        amperes = float(limits["current_range_a"]) / _CODE_SPAN
        volts = float(limits["range_v"]) / _CODE_SPAN
        scales = {"current": amperes, "encoder": 1.0}
        self._scales = _filled([scales.get(word, volts) for word in words], shape, float)
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
        scales = self._scales if n_scans == len(self._scales) else self._scales[:n_scans]
        words = np.ndarray(scales.shape, _WIRE, raw if n_scans else _NOTHING, DATA_AT)
        values: FloatArray = words * scales
        if self.bits & ENCODER_LOW and n_scans:
            self._count(values[:, -1], words, encoder)
        # both ends of at least 8 bits begin with one of two bytes: mostly none of them is there
        high = raw[DATA_AT : DATA_AT + words.nbytes : 2]
        if b"\x7f" in high or b"\x80" in high:
            saturated = self._saturated(words)
        else:
            saturated = np.zeros(scales.shape, dtype=bool)
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

    def _count(self, counts: FloatArray, words: NDArray[np.int16], encoder: int) -> None:
        """Make 32-bit counts of `counts`, which hold the low words."""
        if self.bits & ENCODER_HIGH:
            low = words[:, -1].astype(_WORD).view(_UNSIGNED)
            counts[:] = words[:, -2].astype(np.int64) * 2**16 + low
            return
        first = (encoder + _CODE_SPAN) % 2**16 - _CODE_SPAN
        if abs(first) + self._block_counts < _CODE_SPAN and first == counts[0]:
            # no low word of this block can have wrapped
            if first != encoder:
                counts += encoder - first
            return
        low = words[:, -1].astype(_WORD)
        counts[0] = encoder
        # the difference of 16-bit numbers wraps by itself
        counts[1:] = low[1:] - low[:-1]
        np.add.accumulate(counts, out=counts)


def _filled(
    row: Sequence[float] | NDArray[np.int64], shape: tuple[int, int], dtype: DTypeLike
) -> NDArray[Any]:
    """Return an array of equal rows."""
    return np.ascontiguousarray(np.broadcast_to(np.asarray(row).astype(dtype), shape))
