"""The scan list, the word in it that marks the end of a scan, and words to volts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.daq import Role
from hdbench.drivers.dataq.models import MODELS, Model
from hdbench.drivers.dataq.table import DataqAcquisition, DataqChannel
from hdbench.errors import ProfileError
from hdbench.records.trace import FloatArray

__all__ = ["Marker", "ScanPlan", "channel_number", "plan_scan"]

# a rate input needs the code of a range, the first of them 50 kHz
_DIGITAL, _COUNTER, _RATE = 8, 10, 0x0109
_ENTRIES_MAX = 11
# the digital word: inverted D1, D0 in byte 1, D6 to D0 in byte 2; all other bits are zero
_DIGITAL_MASK = 0x7F03
_FULL = 32768


@dataclass(frozen=True, slots=True)
class Marker:
    """What tells where a scan ends.

    Parameters
    ----------
    position : int
        Word of the scan, from 0, that holds it.
    mask : int
        Bits that stay as they are from scan to scan.
    zeros : int
        Bits that are always zero in every word of the device: those below its resolution.
    """

    position: int
    mask: int
    zeros: int


@dataclass(frozen=True, slots=True)
class ScanPlan:
    """Scan list and scales of one acquisition.

    Parameters
    ----------
    words : tuple of int
        Words of the scan list, in order.
    marker : Marker
        What marks a scan.
    scales : tuple of float
        Units of the role per step of a word, channel by channel.
    bits : int
        Resolution of the analog words, left-justified.
    counter : int or None
        Channel that is the counter, None where there is none.
    """

    words: tuple[int, ...]
    marker: Marker
    scales: tuple[float, ...]
    bits: int
    counter: int | None = None

    @property
    def scan_bytes(self) -> int:
        """Bytes of a scan."""
        return 2 * len(self.words)

    def decode(self, words: NDArray[np.int16]) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return values in the units of their roles, and which of them sit at an end."""
        step = 1 << (16 - self.bits)
        analog = words[:, : len(self.scales)].astype(np.int32) & -step
        saturated = (analog <= -_FULL) | (analog >= _FULL - step)
        values = analog * np.array(self.scales)
        if self.counter is not None:
            values[:, self.counter] = words[:, self.counter].astype(np.int32) + _FULL
            saturated[:, self.counter] = False
        return values, saturated


def channel_number(channel: DataqChannel) -> int:
    """Return the number of an analog channel."""
    return int(channel.input.removeprefix("analog "))


def plan_scan(table: DataqAcquisition, roles: tuple[Role, ...]) -> ScanPlan:
    """Return scan list, marker and scales of some channels.

    Notes
    -----
    The stream has no headers, counters or checksums, so a scan carries a mark of its own: the
    digital inputs, wired to nothing, as its last word. Packets have 2**n bytes. So that the loss of
    one of them is never the loss of whole scans, a scan never has 2**n words: where it would, the
    rate input, wired to nothing either, stands before the mark.
    """
    model = MODELS[table.model]
    channels = {channel.role: channel for channel in table.channels}
    chosen = [channels[role] for role in roles]
    codes = [_word(model, channel) for channel in chosen]
    scales = tuple(channel.scale * channel.range_v / _FULL for channel in chosen)
    counter = roles.index("encoder") if "encoder" in roles else None
    if not model.digital:
        # D1 and D0 come in the lowest bits of the first word, the others end in zeros
        return ScanPlan(tuple(codes), Marker(0, 0x0003, 0x000C), scales, model.bits)
    extra = [_DIGITAL] if (len(codes) + 1) & len(codes) else [_RATE, _DIGITAL]
    words = (*codes, *extra)
    if len(words) > _ENTRIES_MAX:
        raise ProfileError(
            f"{len(words)} entries with the mark; the scan list holds {_ENTRIES_MAX}",
            where="key daq.channels",
            fix="name fewer channels",
        )
    marker = Marker(len(words) - 1, 0xFFFF, 0xFFFF & ~_DIGITAL_MASK)
    return ScanPlan(words, marker, scales, model.bits, counter)


def _word(model: Model, channel: DataqChannel) -> int:
    """Return the scan-list word of a channel."""
    if (channel.role == "encoder") != (channel.input == "counter") or (
        channel.role == "encoder" and not model.digital
    ):
        raise ProfileError(
            f"{channel.role} on {channel.input!r}; an encoder needs the counter of a model that "
            "has one, everything else an analog input",
            where="key daq.channels",
            fix="correct the input, or leave the encoder out: the motor angle is then integrated "
            "from the tacho",
        )
    if channel.input == "counter":
        return _COUNTER
    if channel.range_v not in model.ranges:
        known = ", ".join(f"{value:g}" for value in model.ranges)
        raise ProfileError(
            f"range_v {channel.range_v:g} V; a DI-{model.number} has {known} V",
            where="key daq.channels",
            fix="choose one of its ranges",
        )
    return channel_number(channel) | model.ranges[channel.range_v] << 8
