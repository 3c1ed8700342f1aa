"""The channels of the profile as readings in volts, amperes, counts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from hdbench.devices.capabilities import InputInfo, Role
from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.layout import Block, place_of
from hdbench.devices.modbus.values import range_of, size_of
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusChannel

__all__ = ["Inputs", "Reading", "input_info"]


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
