"""Scan list of the stream, its words to volts and counts, and what a model can do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.devices.daq import Capabilities, InputInfo, Role, WatchdogInfo
from hdbench.devices.registers import Register
from hdbench.drivers.labjack import registers as reg
from hdbench.drivers.labjack.control import Control, Refused
from hdbench.drivers.labjack.table import LabJackAcquisition, LabJackChannel, LabJackOutput
from hdbench.errors import DeviceError, ProfileError
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
        return InputScale(-offset / slope, slope, -slope)
    factor = range_v / 10.0
    return InputScale(33523.0, 3.1580578e-4 * factor, -3.15805800e-4 * factor)


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
        return InputScale(-offset / slope, slope, -slope)
    at = 4 * T7_RANGES_V.index(range_v)
    positive, negative, center = words[at : at + 3]
    sane = _near(positive, nominal.positive_v) and _near(negative, nominal.negative_v)
    if not (sane and _near(center, nominal.center)):
        return None
    return InputScale(center, positive, negative)


def _near(value: float, nominal: float) -> bool:
    return abs(value - nominal) <= _SANE * abs(nominal)


# CORE_TIMER counts at half of the 80 MHz core clock (ljm_constants.json)
CORE_TIMER_HZ = 40e6
QUADRATURE = "quadrature"
# two lines with a counter each that work as a pair
QUADRATURE_LINES = {"T7": (0, 1), "T4": (4, 5)}
# FIO and EIO: the lines whose level one streamed word holds
_STREAMED_LINES = 16
# an analog input never reads 0xFFFF; these are its ends
_LOWEST, _HIGHEST = 0, 0xFFFE


Decoded = tuple[FloatArray, NDArray[np.bool_], NDArray[np.bool_] | None]
"""Scans in the units of their roles, which of them sit at an end, and whether the drive is on."""


@dataclass(frozen=True, slots=True)
class ScanPlan:
    """One acquisition's scan list and how its words are read."""

    addresses: tuple[int, ...]
    columns: tuple[tuple[int, LabJackChannel, InputScale | None], ...]
    line: int | None
    output: LabJackOutput | None
    timer: int

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
        return values, saturated, self._enabled(words)

    def _enabled(self, words: NDArray[np.uint16]) -> NDArray[np.bool_] | None:
        if self.line is None or self.output is None:
            return None
        level = (words[:, self.line] >> self.output.enable_line & 1).astype(bool)
        return level if self.output.enable_high else ~level


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
    addresses = [reg.analog_input(channels[role].number).address for role in analog]
    for role in roles:
        if channels[role].input == QUADRATURE:
            positions[role] = len(addresses)
            first = QUADRATURE_LINES[table.model][0]
            addresses += [reg.ef_count(first).address, reg.STREAM_CAPTURE_16]
    output = table.output
    line = None
    if output is not None and output.enable_line < _STREAMED_LINES:
        line = len(addresses)
        addresses.append(reg.FIO_EIO_STATE)
    timer = len(addresses)
    addresses += [reg.CORE.address, reg.STREAM_CAPTURE_16]
    return ScanPlan(
        tuple(addresses),
        tuple((positions[role], channels[role], scales.get(role)) for role in roles),
        line,
        output,
        timer,
    )


_T4_HIGH_V = 10.0
# single-ended inputs of the device itself; above them are those of multiplexer boards
_T7_INPUTS = 14
_T7_DIFFERENTIAL = range(0, 13, 2)


def check_table(table: LabJackAcquisition) -> None:
    """Refuse a table that the model cannot carry out."""
    problems = list(_model_problems(table))
    for channel in table.channels:
        problems += _channel_problems(table.model, channel)
    problems += _line_problems(table)
    if problems:
        raise ProfileError.several(
            [ProfileError(what, where=f"key daq.{key}", fix=fix) for key, what, fix in problems]
        )


_Problem = tuple[str, str, str]


def _model_problems(table: LabJackAcquisition) -> Iterator[_Problem]:
    if table.model == "T4" and not table.auto_recover:
        yield "auto_recover", "a T4 always goes on after a full buffer", "set it to true"
    if table.model not in ("T4", "T7"):
        what = f"{table.model} is not supported: how its streamed words become volts is published "
        what += "only as part of its maker's library"
        yield "model", what, 'use model = "T7" or "T4"'
    if all(channel.input == QUADRATURE for channel in table.channels):
        yield "channels", "no analog input; the stream needs one", "add the torque channel"


def _channel_problems(model: str, channel: LabJackChannel) -> Iterator[_Problem]:
    key = f"channels (role {channel.role})"
    if (channel.input == QUADRATURE) != (channel.role == "encoder"):
        yield key, f"{channel.input} as {channel.role}", "quadrature is for the encoder alone"
        return
    if channel.input == QUADRATURE:
        return
    number, range_v, negative = channel.number, channel.range_v, channel.negative
    if model == "T4":
        if not (number < _T4_HIGH and range_v == _T4_HIGH_V):
            what = f"AIN{number} with +-{range_v:g} V; a bench needs both signs, which a T4 has on "
            what += "AIN0 to AIN3 with +-10 V only"
            yield key, what, "use AIN0 to AIN3 and range_v = 10.0"
        if negative is not None:
            yield key, "a T4 has no differential inputs", "leave negative out"
        return
    if number >= _T7_INPUTS:
        yield key, f"AIN{number}; a T7 has AIN0 to AIN13", "use one of those"
    if range_v not in T7_RANGES_V:
        yield key, f"range_v {range_v:g} V; a T7 has 10, 1, 0.1, 0.01 V", "use one of those"
    if negative is not None and not (number in _T7_DIFFERENTIAL and negative == number + 1):
        what = f"AIN{number} against AIN{negative}; a T7 takes an even input against the next one, "
        yield key, what + "up to AIN12", "wire it so, or leave negative out"


def _line_problems(table: LabJackAcquisition) -> Iterator[_Problem]:
    output = table.output
    if output is None:
        return
    taken: dict[int, str] = {}
    if any(channel.input == QUADRATURE for channel in table.channels) and table.model != "T8":
        taken.update(dict.fromkeys(QUADRATURE_LINES[table.model], "the encoder"))
    if output.output.startswith("TDAC"):
        first = int(output.output.removeprefix("TDAC")) // 2 * 2
        if first in taken or first + 1 in taken:
            what = f"{output.output} needs DIO{first} and DIO{first + 1}, which the encoder has"
            yield "output.output", what, "plug the LJTick-DAC into another pair of lines"
        taken.update(dict.fromkeys((first, first + 1), "the LJTick-DAC"))
    line = output.enable_line
    if line in taken:
        yield "output.enable_line", f"DIO{line} belongs to {taken[line]}", "use a free line"
    if table.model == "T4" and line < _T4_HIGH:
        what = f"DIO{line} of a T4 is an analog input"
        yield "output.enable_line", what, "use DIO4 or above"


# samples per second of all channels together (labjack.com, T-series data sheet, 3.2)
_SAMPLES_HZ = {"T7": 100_000.0, "T4": 50_000.0}
_BITS = {"T7": 16, "T4": 12}
_MIN_RATE_HZ = 0.02


def describe_abilities(table: LabJackAcquisition) -> Capabilities:
    """Return the abilities.

    The highest rate is the data sheet's total divided by the words of a scan. What a small input
    range or a high resolution takes from it is not published in a form that was checked; the device
    itself ends a stream that cannot keep its rate (SCAN_OVERLAP).
    """
    counts = range(1, len(table.roles) + 1)
    words = [len(plan_scan(table, table.roles[:count], {}).addresses) for count in counts]
    output = table.output
    tick_dac = output is not None and output.output.startswith("TDAC")
    drops = ("enable",) if tick_dac else ("reference", "enable")
    return Capabilities(
        inputs=tuple(_input(channel, table.model) for channel in table.channels),
        max_rates_hz=tuple(_SAMPLES_HZ[table.model] / count for count in words),
        min_rate_hz=_MIN_RATE_HZ,
        reference=output is not None,
        enable=output is not None,
        watchdog=None if output is None else WatchdogInfo(1.0, 5.0, "key", drops),
    )


def _input(channel: LabJackChannel, model: str) -> InputInfo:
    if channel.input == QUADRATURE:
        return InputInfo(channel.role, -(2.0**31), 2.0**31 - 1.0, 32, 2**32)
    end = channel.range_v * abs(channel.scale)
    return InputInfo(channel.role, -end, end, _BITS[model])


def read_inputs(control: Control, table: LabJackAcquisition) -> dict[Role, float]:
    """Return one reading of every channel in one transaction, outside of a stream."""
    registers = [
        reg.ef_count(QUADRATURE_LINES[table.model][0])
        if channel.input == QUADRATURE
        else reg.analog_input(channel.number)
        for channel in table.channels
    ]
    values = control.read(*registers)
    return {
        channel.role: float(value) * (1.0 if channel.input == QUADRATURE else channel.scale)
        for channel, value in zip(table.channels, values, strict=True)
    }


def input_scales(control: Control, table: LabJackAcquisition) -> dict[Role, InputScale]:
    """Return the scale of every analog channel, from the device's flash or nominal."""
    analog = [channel for channel in table.channels if channel.input != QUADRATURE]
    if table.calibration == "nominal":
        return {
            channel.role: nominal_scale(table.model, channel.number, channel.range_v)
            for channel in analog
        }
    words = _calibration_words(control, table.model)
    scales: dict[Role, InputScale] = {}
    for channel in analog:
        scale = scale_from_flash(table.model, words, channel.number, channel.range_v)
        if scale is None:
            raise DeviceError(
                f"the calibration constants of {channel.input} are more than 5 % from their "
                "nominal values",
                where=f"{control.where}, flash 0x{FLASH_ADDRESS:X}",
                fix='have the device calibrated, or set daq.calibration = "nominal" and doubt the '
                "volts",
            )
        scales[channel.role] = scale
    return scales


def _calibration_words(control: Control, model: str) -> list[float]:
    """Return the calibration block; a read of 20 words at a time, from a pointer written before."""
    words: list[float] = []
    while len(words) < FLASH_WORDS[model]:
        count = min(20, FLASH_WORDS[model] - len(words))
        registers = reg.flash_words(count)
        pointer = FLASH_ADDRESS + 4 * len(words)
        control.feedback(((reg.FLASH_POINTER, pointer),), repeatable=True)
        words += [float(value) for value in control.read_block(registers)]
    return words


# the device's own code for stopping a stream that does not run
_NOT_RUNNING = 2620
_SINGLE_ENDED = 199
_QUADRATURE_INDEX = 10
# a packet is to hold this time, so that data are not older; 512 samples is a packet's limit
_PACKET_S = 0.02
_MAX_SAMPLES = 512
# the scan clock's grain is 100 ns up to 6.5 ms and 1 ms at worst for 60 s: below 2 in 1e4 of any
# period that a profile may ask for
_RATE_TOLERANCE = 2e-4


@dataclass(frozen=True, slots=True)
class StreamSetup:
    """What the device was set to."""

    period_s: float
    samples_per_packet: int


def stop_stream(control: Control) -> None:
    """Stop a stream, one that a dead host has left included."""
    try:
        control.feedback(((reg.STREAM_ENABLE, 0),), repeatable=True)
    except Refused as refused:
        if refused.code != _NOT_RUNNING:
            raise
    if control.read(reg.STREAM_ENABLE)[0]:
        what = "the stream goes on after it was stopped"
        raise control.error_at(reg.STREAM_ENABLE, what, "switch the device off and on")


def set_up_inputs(control: Control, table: LabJackAcquisition) -> None:
    """Set ranges, negative sides and the encoder's counter, only where they differ."""
    analog = [channel for channel in table.channels if channel.input != QUADRATURE]
    # a T4 has neither ranges nor negative sides
    for channel in analog if table.model == "T7" else ():
        number = channel.number
        negative = _SINGLE_ENDED if channel.negative is None else channel.negative
        _ensure(control, reg.analog_range(number), channel.range_v)
        _ensure(control, reg.negative_channel(number), negative)
    if len(analog) < len(table.channels):
        _set_up_counter(control, table.model)


def _set_up_counter(control: Control, model: str) -> None:
    """Pair two lines as a quadrature counter; one that counts already goes on counting."""
    lines = QUADRATURE_LINES[model]
    wanted = (_QUADRATURE_INDEX, 1)
    if all(tuple(control.read(reg.ef_index(n), reg.ef_enable(n))) == wanted for n in lines):
        return
    for value, register in (
        (0, reg.ef_enable),
        (_QUADRATURE_INDEX, reg.ef_index),
        (1, reg.ef_enable),
    ):
        for number in lines:
            control.write((register(number),), (value,))
    for number in lines:
        _ensure(control, reg.ef_index(number), _QUADRATURE_INDEX)
        _ensure(control, reg.ef_enable(number), 1)


def set_up_stream(
    control: Control, plan: ScanPlan, sample_period_s: float, *, stop_when_full: bool | None
) -> StreamSetup:
    """Write the stream's settings and return what they read back as."""
    entries = len(plan.addresses)
    scans = max(1, min(round(_PACKET_S / sample_period_s), _MAX_SAMPLES // entries))
    wanted = (1.0 / sample_period_s, entries, scans * entries, 0.0, 0, reg.BUFFER_SIZE)
    control.write(reg.STREAM_SETUP, wanted)
    # to Ethernet, 16-bit samples, until it is stopped
    control.write(reg.STREAM_TARGET, (1, 0, 0))
    if stop_when_full is not None:
        _ensure(control, reg.STREAM_AUTORECOVER_DISABLE, int(stop_when_full))
    addresses = tuple(reg.scan_list(position) for position in range(entries))
    control.write(addresses, plan.addresses)
    _check(control, addresses, plan.addresses)
    _check(control, reg.STREAM_SETUP[1:], wanted[1:])
    _check(control, (reg.STREAM_TARGET[0], reg.STREAM_TARGET[2]), (1, 0))
    rate_hz = float(control.read(reg.STREAM_SETUP[0])[0])
    if not abs(rate_hz * sample_period_s - 1.0) <= _RATE_TOLERANCE:
        raise control.error_at(
            reg.STREAM_SETUP[0],
            f"the device scans at {rate_hz:.6g} Hz; asked for {1.0 / sample_period_s:.6g} Hz",
            "choose a sample period of whole microseconds, or milliseconds above 6 ms",
        )
    return StreamSetup(1.0 / rate_hz, scans * entries)


def _ensure(control: Control, register: Register, value: float) -> None:
    """Write a setting where it differs, and read it back."""
    if not _same(control.read(register)[0], value):
        control.write((register,), (value,))
        _check(control, (register,), (value,))


def _check(control: Control, registers: tuple[Register, ...], wanted: tuple[float, ...]) -> None:
    found: list[float | int] = []
    for at in range(0, len(registers), 30):
        found += control.read(*registers[at : at + 30])
    for register, value, asked in zip(registers, found, wanted, strict=True):
        if not _same(value, asked):
            what = f"{register.name} reads back as {value:g}; written: {asked:g}"
            fix = "compare the value with the device's data sheet and its firmware version"
            raise control.error_at(register, what, fix)


def _same(found: float, wanted: float) -> bool:
    # values travel as 32-bit floats
    return abs(found - wanted) <= 1e-6 * abs(wanted)
