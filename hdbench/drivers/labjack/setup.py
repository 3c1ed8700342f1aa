"""Settings of inputs and stream, read back; single readings and calibration constants."""

from __future__ import annotations

from dataclasses import dataclass

from hdbench.devices.daq import Role
from hdbench.devices.registers import Register
from hdbench.drivers.labjack.control import Control, Refused
from hdbench.drivers.labjack.registers import (
    BUFFER_SIZE,
    FLASH_POINTER,
    STREAM_AUTORECOVER_DISABLE,
    STREAM_ENABLE,
    STREAM_SETUP,
    STREAM_TARGET,
    analog_input,
    analog_range,
    ef_count,
    ef_enable,
    ef_index,
    flash_words,
    negative_channel,
    scan_list,
)
from hdbench.drivers.labjack.scanlist import (
    FLASH_ADDRESS,
    FLASH_WORDS,
    QUADRATURE,
    InputScale,
    ScanPlan,
    nominal_scale,
    quadrature_lines,
    scale_from_flash,
)
from hdbench.drivers.labjack.table import LabJackAcquisition
from hdbench.errors import DeviceError


def read_inputs(control: Control, table: LabJackAcquisition) -> dict[Role, float]:
    """Return one reading of every channel in one transaction, outside of a stream."""
    registers = [
        ef_count(quadrature_lines(table.model)[0])
        if channel.input == QUADRATURE
        else analog_input(channel.number)
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
        registers = flash_words(count)
        pointer = FLASH_ADDRESS + 4 * len(words)
        control.feedback(((FLASH_POINTER, pointer),), repeatable=True)
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
        control.feedback(((STREAM_ENABLE, 0),), repeatable=True)
    except Refused as refused:
        if refused.code != _NOT_RUNNING:
            raise
    if control.read(STREAM_ENABLE)[0]:
        raise DeviceError(
            "the stream goes on after it was stopped",
            where=f"{control.where}, register {STREAM_ENABLE.describe()}",
            fix="switch the device off and on",
        )


def set_up_inputs(control: Control, table: LabJackAcquisition) -> None:
    """Set ranges, negative sides and the encoder's counter, only where they differ."""
    analog = [channel for channel in table.channels if channel.input != QUADRATURE]
    # a T4 has neither ranges nor negative sides
    for channel in analog if table.model == "T7" else ():
        number = channel.number
        negative = _SINGLE_ENDED if channel.negative is None else channel.negative
        _ensure(control, analog_range(number), channel.range_v)
        _ensure(control, negative_channel(number), negative)
    if len(analog) < len(table.channels):
        _set_up_counter(control, table.model)


def _set_up_counter(control: Control, model: str) -> None:
    """Pair two lines as a quadrature counter; one that counts already goes on counting."""
    lines = quadrature_lines(model)
    wanted = (_QUADRATURE_INDEX, 1)
    if all(tuple(control.read(ef_index(n), ef_enable(n))) == wanted for n in lines):
        return
    for value, register in ((0, ef_enable), (_QUADRATURE_INDEX, ef_index), (1, ef_enable)):
        for number in lines:
            control.write((register(number),), (value,))
    for number in lines:
        _ensure(control, ef_index(number), _QUADRATURE_INDEX)
        _ensure(control, ef_enable(number), 1)


def set_up_stream(
    control: Control, plan: ScanPlan, sample_period_s: float, *, stop_when_full: bool | None
) -> StreamSetup:
    """Write the stream's settings and return what they read back as."""
    entries = len(plan.addresses)
    scans = max(1, min(round(_PACKET_S / sample_period_s), _MAX_SAMPLES // entries))
    wanted = (1.0 / sample_period_s, entries, scans * entries, 0.0, 0, BUFFER_SIZE)
    control.write(STREAM_SETUP, wanted)
    # to Ethernet, 16-bit samples, until it is stopped
    control.write(STREAM_TARGET, (1, 0, 0))
    if stop_when_full is not None:
        _ensure(control, STREAM_AUTORECOVER_DISABLE, int(stop_when_full))
    addresses = tuple(scan_list(position) for position in range(entries))
    control.write(addresses, plan.addresses)
    _check(control, addresses, plan.addresses)
    _check(control, STREAM_SETUP[1:], wanted[1:])
    _check(control, (STREAM_TARGET[0], STREAM_TARGET[2]), (1, 0))
    rate_hz = float(control.read(STREAM_SETUP[0])[0])
    check_rate(control.where, rate_hz, sample_period_s)
    return StreamSetup(1.0 / rate_hz, scans * entries)


def check_rate(where: str, rate_hz: float, sample_period_s: float) -> None:
    """Refuse a scan rate that is not the one asked for."""
    if not abs(rate_hz * sample_period_s - 1.0) <= _RATE_TOLERANCE:
        raise DeviceError(
            f"the device scans at {rate_hz:.6g} Hz; asked for {1.0 / sample_period_s:.6g} Hz",
            where=f"{where}, register {STREAM_SETUP[0].describe()}",
            fix="choose a sample period of whole microseconds, or milliseconds above 6 ms",
        )


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
            raise DeviceError(
                f"{register.name} reads back as {value:g}; written: {asked:g}",
                where=f"{control.where}, register {register.describe()}",
                fix="compare the value with the device's data sheet and its firmware version",
            )


def _same(found: float, wanted: float) -> bool:
    # values travel as 32-bit floats
    return abs(found - wanted) <= 1e-6 * abs(wanted)
