"""Inputs of a polled device: channels as readings, one per period, timed by this computer."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from hdbench.devices.base import WAIT_S, StreamedAcquisition
from hdbench.devices.daq import DaqSettings, InputInfo, Role, ScanBlock
from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.layout import place_of
from hdbench.devices.registers import range_of, size_of
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusChannel


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of some channels.

    Parameters
    ----------
    values : tuple of float
        In the units of their roles.
    saturated : tuple of bool
        Whether each sits at the end of its range.
    doubt : str
        Why it is none: a channel told that it has no reading. Empty where all are good.
    read_s : tuple of float
        Host's clock before the first request and after the last reply, s.
    """

    values: tuple[float, ...]
    saturated: tuple[bool, ...]
    doubt: str
    read_s: tuple[float, float]


class Inputs:
    """Reads some channels of the profile, all at once, in the order of `roles`."""

    def __init__(self, access: Access, table: ModbusAcquisition, roles: tuple[Role, ...]) -> None:
        channels = {channel.role: channel for channel in table.channels}
        self._access = access
        self._channels = [channels[role] for role in roles]
        self._infos = [input_info(table, channel) for channel in self._channels]
        self._places = [place_of(table, channel) for channel in self._channels]
        # words that tell about a channel: its status and its sign, None where it has none
        self._words = [
            [None if word is None else place_of(table, word) for word in (c.status, c.sign)]
            for c in self._channels
        ]
        self._wanted = list(
            dict.fromkeys([*self._places, *(w for both in self._words for w in both if w)])
        )

    def read(self) -> Reading:
        """Return one reading; raises as `Access.read`."""
        before_s = time.monotonic()
        found = dict(zip(self._wanted, self._access.read(self._wanted), strict=True))
        read_s = (before_s, time.monotonic())
        doubt, values, saturated = "", list[float](), list[bool]()
        for channel, info, place, (state, sign) in zip(
            self._channels, self._infos, self._places, self._words, strict=True
        ):
            number = found[place]
            doubt = doubt or _doubt(channel, number, None if state is None else int(found[state]))
            if sign is not None and channel.sign is not None:
                number *= -1 if int(found[sign]) >> channel.sign.bit & 1 else 1
            values.append(_scaled(channel, number))
            saturated.append(not info.wrap and not info.low < values[-1] < info.high)
        return Reading(tuple(values), tuple(saturated), doubt, read_s)


def input_info(table: ModbusAcquisition, channel: ModbusChannel) -> InputInfo:
    """Return what a channel can show."""
    wrap = 0 if channel.wrap_bits is None else 1 << channel.wrap_bits
    lowest, highest = range_of(channel.type)
    if channel.sign is not None:
        lowest = -highest
    ends = [channel.offset + channel.scale * end for end in (lowest, highest)]
    low, high = min(ends), max(ends)
    if not math.isfinite(high - low):
        low, high = -table.range_v, table.range_v
    low = low if channel.low is None else channel.low
    high = high if channel.high is None else channel.high
    bits = 0 if channel.type.startswith("f") else 16 * size_of(channel.type)
    if wrap:
        return InputInfo(channel.role, 0.0, wrap - 1.0, channel.wrap_bits or 0, wrap)
    return InputInfo(channel.role, low, high, bits)


def _scaled(channel: ModbusChannel, raw: float | int) -> float:
    if channel.wrap_bits is not None:
        return float(int(raw) % (1 << channel.wrap_bits))
    return channel.offset + channel.scale * raw


def _doubt(channel: ModbusChannel, raw: float | int, state: int | None) -> str:
    """Return why a channel has no reading; empty where it has one."""
    if not math.isfinite(raw) or raw in channel.invalid:
        return f"{channel.role} reads {raw:g}, which stands for no reading"
    status = channel.status
    if status is None or state is None or state & status.mask == status.good:
        return ""
    return f"the status word of {channel.role} reads 0x{state & status.mask:X}"


class Polling(StreamedAcquisition):
    """Delivers one reading per period, each with its time.

    Reading k is due at start + k period. It belongs to the index whose due time is nearest to the
    middle between its request and its reply; an index that none came for is counted as lost, and
    so is one whose reading the device itself calls invalid.
    """

    def __init__(self, inputs: Inputs, settings: DaqSettings) -> None:
        super().__init__(settings.n_samples, settings.sample_period_s)
        self._inputs = inputs
        self._n_roles = len(settings.roles)
        self._start_s = 0.0
        self._next = 0

    def begin(self) -> None:
        """Begin: index 0 is due now."""
        super().begin()
        self._start_s = time.monotonic()

    def next_block(self, *, tripped: bool) -> ScanBlock | None:
        """Return the next reading; None when none is due yet, or it was invalid."""
        now_s = time.monotonic()
        if self.stopped or self._next >= self._n_samples:
            return self._block(None, (now_s, now_s), tripped=tripped)
        wait_s = self._start_s + self._next * self._packet_s - now_s
        if wait_s > 0.0:
            time.sleep(min(wait_s, WAIT_S))
            if wait_s > WAIT_S:
                return None
        reading = self._inputs.read()
        read_s = reading.read_s
        index = max(self._next, round((0.5 * sum(read_s) - self._start_s) / self._packet_s))
        in_time = index < self._n_samples
        self._next = min(index + 1, self._n_samples)
        if in_time and reading.doubt:
            return None
        return self._block(reading if in_time else None, read_s, tripped=tripped)

    def _block(
        self, reading: Reading | None, read_s: tuple[float, float], *, tripped: bool
    ) -> ScanBlock:
        """Return one reading, or an empty block, with what was lost before it."""
        shape = (0 if reading is None else 1, self._n_roles)
        return self._delivered(
            np.reshape(() if reading is None else reading.values, shape).astype(np.float64),
            np.reshape(() if reading is None else reading.saturated, shape).astype(bool),
            read_s,
            lost=self._next - shape[0] - self.delivered,
            tripped=tripped,
            time_s=np.full(shape[0], 0.5 * sum(read_s)),
        )
