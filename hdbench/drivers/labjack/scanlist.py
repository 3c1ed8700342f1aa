"""Scan list of the stream, and its words back to volts and counts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from hdbench.drivers.labjack.stream import CORE_TIMER_HZ, ScanLayout
from hdbench.drivers.labjack.table import LabJackAcquisition, LabJackChannel
from hdbench.records.trace import FloatArray

# where the calibration stands, and how many 32-bit floats it has per model
FLASH_ADDRESS = 0x3C4000
FLASH_WORDS = {"T7": 41, "T4": 19}
T7_RANGES_V = (10.0, 1.0, 0.1, 0.01)
# high-voltage inputs AIN0 to AIN3 of the T4
_T4_HIGH = 4
# constants may differ from the nominal ones by their tolerance, not by this factor: an erased or
# foreign flash reads otherwise
_SANE = 0.05


@dataclass(frozen=True, slots=True)
class InputScale:
    """Volts of a streamed word.

    T7: v = (word - center) positive_v for word >= center, else (center - word) negative_v. A T4's
    v = slope word + offset is the same with center = -offset / slope.
    """

    center: float
    positive_v: float
    negative_v: float
    source: str

    def volts(self, words: NDArray[np.uint16]) -> FloatArray:
        """Return the volts of streamed words."""
        from_center = words.astype(np.float64) - self.center
        slope = np.where(from_center >= 0.0, self.positive_v, -self.negative_v)
        volts: FloatArray = from_center * slope
        return volts


def nominal_scale(model: str, number: int, range_v: float) -> InputScale:
    """Return the scale of an uncalibrated device.

    Nominal constants of LabJack's data sheet, appendix "Internal flash", for the T7's +-10 V range;
    its other ranges are tenths of it.
    """
    if model == "T4":
        slope, offset = (3.235316e-4, -10.532965) if number < _T4_HIGH else (3.826692e-5, 0.002484)
        return InputScale(-offset / slope, slope, -slope, "nominal")
    factor = range_v / 10.0
    return InputScale(33523.0, 3.1580578e-4 * factor, -3.15805800e-4 * factor, "nominal")


def scale_from_flash(
    model: str, words: Sequence[float], number: int, range_v: float
) -> InputScale | None:
    """Return the scale that the device's flash gives; None where that cannot be one.

    T7: 8 groups of positive slope, negative slope, centre, offset: high speed with gain 1, 10, 100,
    1000, then high resolution; streams use the first four. T4: slope and offset of AIN0 to AIN3,
    then of the low-voltage inputs.
    """
    nominal = nominal_scale(model, number, range_v)
    if model == "T4":
        at = 2 * min(number, _T4_HIGH)
        slope, offset = words[at : at + 2]
        if not _near(slope, nominal.positive_v):
            return None
        return InputScale(-offset / slope, slope, -slope, "device")
    at = 4 * T7_RANGES_V.index(range_v)
    positive, negative, center = words[at : at + 3]
    sane = _near(positive, nominal.positive_v) and _near(negative, nominal.negative_v)
    if not (sane and _near(center, nominal.center)):
        return None
    return InputScale(center, positive, negative, "device")


def _near(value: float, nominal: float) -> bool:
    return abs(value - nominal) <= _SANE * abs(nominal)


QUADRATURE = "quadrature"
# two lines with a counter each that work as a pair
_PAIRS = {"T7": (0, 1), "T4": (4, 5)}
# FIO and EIO: the lines whose level one streamed word holds
_STREAMED_LINES = 16
# an analog input never reads 0xFFFF; these are its ends
_LOWEST, _HIGHEST = 0, 0xFFFE


@dataclass(frozen=True, slots=True)
class Decoded:
    """Scans in the units of their roles."""

    values: FloatArray
    saturated: NDArray[np.bool_]
    enabled: NDArray[np.bool_] | None


@dataclass(frozen=True, slots=True)
class ScanPlan:
    """One acquisition's scan list and how its words are read."""

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
