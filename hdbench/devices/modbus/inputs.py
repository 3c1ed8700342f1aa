"""Inputs of a polled device: channels as readings, one per period, timed by this computer."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hdbench.devices.daq import InputInfo, Role, ScanBlock
from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.layout import Block, place_of
from hdbench.devices.registers import range_of, size_of
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusChannel

# longest wait of one call, s
_WAIT_S = 0.02


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
    before_s, after_s : float
        Host's clock before the first request and after the last reply, s.
    """

    values: tuple[float, ...]
    saturated: tuple[bool, ...]
    doubt: str
    before_s: float
    after_s: float


class Inputs:
    """Reads some channels of the profile, all at once.

    Parameters
    ----------
    access : Access
        The device.
    table : ModbusAcquisition
        ``[daq]``.
    roles : tuple of Role
        Which channels, in the order of a reading.
    clock : callable
        Monotonic clock, s.
    """

    def __init__(
        self,
        access: Access,
        table: ModbusAcquisition,
        roles: tuple[Role, ...],
        clock: Callable[[], float],
    ) -> None:
        channels = {channel.role: channel for channel in table.channels}
        self._access = access
        self._clock = clock
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

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Requests of one reading."""
        return self._access.blocks(self._wanted)

    def read(self) -> Reading:
        """Return one reading; raises as `Access.read`."""
        before_s = self._clock()
        found = dict(zip(self._wanted, self._access.read(self._wanted), strict=True))
        after_s = self._clock()
        doubt, raw = "", []
        for channel, place, (state, sign) in zip(
            self._channels, self._places, self._words, strict=True
        ):
            number = found[place]
            doubt = doubt or _doubt(channel, number, None if state is None else int(found[state]))
            negative = (
                sign is not None
                and channel.sign is not None
                and (int(found[sign]) >> channel.sign.bit & 1)
            )
            raw.append(-number if negative else number)
        values = tuple(_scaled(c, n) for c, n in zip(self._channels, raw, strict=True))
        saturated = tuple(
            not info.wrap and not info.low < value < info.high
            for info, value in zip(self._infos, values, strict=True)
        )
        return Reading(values, saturated, doubt, before_s, after_s)


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


class Polling:
    """Delivers one reading per period, each with its time.

    Parameters
    ----------
    inputs : Inputs
        What is read.
    n_channels, n_samples : int
        Channels of a reading, and how many are wanted.
    period_s : float
        Sampling period, s.
    clock, sleep : callable
        Monotonic clock in s, and waiting.

    Notes
    -----
    Reading k is due at start + k period. It belongs to the index whose due time is nearest to the
    middle between its request and its reply; an index that none came for is counted as lost, and
    so is one whose reading the device itself calls invalid.
    """

    def __init__(
        self,
        inputs: Inputs,
        n_channels: int,
        n_samples: int,
        period_s: float,
        clock: Callable[[], float],
        sleep: Callable[[float], None],
    ) -> None:
        self.started = False
        self.stopped = False
        self._inputs = inputs
        self._n_channels = n_channels
        self._n_samples = n_samples
        self._period_s = period_s
        self._clock = clock
        self._sleep = sleep
        self._start_s = 0.0
        self._next = 0
        self._untold = 0

    @property
    def sampling(self) -> bool:
        """Whether readings are still to come."""
        return self.started and not self.stopped and self._next < self._n_samples

    def start(self) -> None:
        """Begin: index 0 is due now."""
        self.started = True
        self._start_s = self._clock()

    def stop(self) -> None:
        """Read no more."""
        self.stopped = True

    def next_block(self, *, tripped: bool) -> ScanBlock | None:
        """Return the next reading; None when none is due yet, or it was invalid."""
        if not self.sampling:
            return self._last(tripped=tripped)
        wait_s = self._start_s + self._next * self._period_s - self._clock()
        if wait_s > 0.0:
            self._sleep(min(wait_s, _WAIT_S))
            if wait_s > _WAIT_S:
                return None
        reading = self._inputs.read()
        middle_s = 0.5 * (reading.before_s + reading.after_s)
        index = max(self._next, round((middle_s - self._start_s) / self._period_s))
        if index >= self._n_samples:
            self._untold += self._n_samples - self._next
            self._next = self._n_samples
            return self._last(tripped=tripped)
        lost, self._untold = self._untold + index - self._next, 0
        self._next = index + 1
        if reading.doubt:
            self._untold = lost + 1
            return None
        return ScanBlock(
            first_index=index,
            lost_before=lost,
            values=np.array([reading.values], dtype=np.float64),
            saturated=np.array([reading.saturated], dtype=bool),
            running=self._next < self._n_samples,
            watchdog_tripped=tripped,
            depth=0,
            read_s=(reading.before_s, reading.after_s),
            time_s=np.array([middle_s]),
        )

    def _last(self, *, tripped: bool) -> ScanBlock:
        """Return an empty block; losses at the end are told with it."""
        lost, self._untold = self._untold, 0
        now_s = self._clock()
        return ScanBlock(
            first_index=self._next,
            lost_before=lost,
            values=np.zeros((0, self._n_channels)),
            saturated=np.zeros((0, self._n_channels), dtype=bool),
            running=False,
            watchdog_tripped=tripped,
            depth=0,
            read_s=(now_s, now_s),
            time_s=np.zeros(0),
        )
