"""What a scan holds: the stream's list of addresses, and its words back to volts and counts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.daq import Role
from hdbench.drivers.labjack.registers import (
    CORE,
    FIO_EIO_STATE,
    STREAM_CAPTURE_16,
    analog_input,
    ef_count,
)
from hdbench.drivers.labjack.scaling import InputScale
from hdbench.drivers.labjack.scans import CORE_TIMER_HZ, ScanLayout
from hdbench.drivers.labjack.table import LabJackAcquisition, LabJackChannel
from hdbench.records.trace import FloatArray

__all__ = ["Decoded", "ScanPlan", "input_number", "plan_scan", "quadrature_lines"]

QUADRATURE = "quadrature"
# two lines with a counter each that work as a pair
_PAIRS = {"T7": (0, 1), "T4": (4, 5)}
# FIO and EIO: the lines whose level one streamed word holds
_STREAMED_LINES = 16
# an analog input never reads 0xFFFF; these are its ends
_LOWEST, _HIGHEST = 0, 0xFFFE


@dataclass(frozen=True, slots=True)
class Decoded:
    """Scans in the units of their roles.

    Parameters
    ----------
    values : ndarray, shape (n, roles)
        V, A or counts.
    saturated : ndarray of bool, shape (n, roles)
        True at the ends of an analog range.
    enabled : ndarray of bool, shape (n,), or None
        Level of the enable line in every scan, as on or off; None where it is not streamed.
    """

    values: FloatArray
    saturated: NDArray[np.bool_]
    enabled: NDArray[np.bool_] | None


@dataclass(frozen=True, slots=True)
class ScanPlan:
    """One acquisition's scan list and how its words are read.

    Parameters
    ----------
    addresses : tuple of int
        What is written to the device.
    columns : tuple of tuple
        Per role: position of its first word, its channel, and its scale; None for a counter.
    line : int or None
        Position of the word with the enable line.
    line_bit : int
        Bit of it.
    line_high : bool
        Whether a high line enables the drive.
    timer : int
        Position of the core timer's low word.
    """

    addresses: tuple[int, ...]
    columns: tuple[tuple[int, LabJackChannel, InputScale | None], ...]
    line: int | None
    line_bit: int
    line_high: bool
    timer: int

    def layout(self, period_s: float) -> ScanLayout:
        """Return what the scan counter needs to know."""
        return ScanLayout(len(self.addresses), self.timer, period_s * CORE_TIMER_HZ)

    def decode(self, words: NDArray[np.uint16]) -> Decoded:
        """Return scans in units."""
        values = np.empty((len(words), len(self.columns)))
        saturated = np.zeros(values.shape, dtype=bool)
        for column, (at, channel, scale) in enumerate(self.columns):
            word = words[:, at]
            if scale is None:
                high = words[:, at + 1].astype(np.int64) << 16
                values[:, column] = (high + word.astype(np.int64)).astype(np.int32)
                continue
            volts = scale.volts(word)
            values[:, column] = volts * channel.scale
            saturated[:, column] = (
                (np.abs(volts) >= channel.range_v) | (word <= _LOWEST) | (word >= _HIGHEST)
            )
        return Decoded(values, saturated, self._enabled(words))

    def _enabled(self, words: NDArray[np.uint16]) -> NDArray[np.bool_] | None:
        if self.line is None:
            return None
        level = (words[:, self.line] >> self.line_bit & 1).astype(bool)
        return level if self.line_high else ~level


def input_number(channel: LabJackChannel) -> int:
    """Return n of AINn."""
    return int(channel.input.removeprefix("AIN"))


def quadrature_lines(model: str) -> tuple[int, int]:
    """Return the lines of the encoder."""
    return _PAIRS[model]


def plan_scan(
    table: LabJackAcquisition,
    roles: tuple[Role, ...],
    scales: Mapping[Role, InputScale],
) -> ScanPlan:
    """Return the scan list for `roles`."""
    channels = {channel.role: channel for channel in table.channels}
    analog = [role for role in roles if channels[role].input != QUADRATURE]
    if not analog:
        # a joint is told by an analog input alone: one is scanned, and its values are left out
        analog = [role for role in channels if channels[role].input != QUADRATURE][:1]
    positions = {role: number for number, role in enumerate(analog)}
    addresses = [analog_input(input_number(channels[role])).address for role in analog]
    for role in roles:
        if channels[role].input == QUADRATURE:
            positions[role] = len(addresses)
            first = quadrature_lines(table.model)[0]
            addresses += [ef_count(first).address, STREAM_CAPTURE_16]
    output = table.output
    line = None
    if output is not None and output.enable_line < _STREAMED_LINES:
        line = len(addresses)
        addresses.append(FIO_EIO_STATE)
    timer = len(addresses)
    addresses += [CORE.address, STREAM_CAPTURE_16]
    return ScanPlan(
        tuple(addresses),
        tuple((positions[role], channels[role], scales.get(role)) for role in roles),
        line,
        output.enable_line if output is not None else 0,
        output.enable_high if output is not None else True,
        timer,
    )
