"""Single readings, and the constants that turn streamed words into volts."""

from __future__ import annotations

from hdbench.devices.daq import Role
from hdbench.drivers.labjack.control import Control
from hdbench.drivers.labjack.registers import (
    FLASH_POINTER,
    analog_input,
    ef_count,
    flash_words,
)
from hdbench.drivers.labjack.scaling import (
    FLASH_ADDRESS,
    FLASH_WORDS,
    InputScale,
    nominal_scale,
    scale_from_flash,
)
from hdbench.drivers.labjack.scanlist import QUADRATURE, input_number, quadrature_lines
from hdbench.drivers.labjack.table import LabJackAcquisition
from hdbench.errors import DeviceError

__all__ = ["input_scales", "read_inputs"]


def read_inputs(control: Control, table: LabJackAcquisition) -> dict[Role, float]:
    """Return one reading of every channel in one transaction, outside of a stream."""
    registers = [
        ef_count(quadrature_lines(table.model)[0])
        if channel.input == QUADRATURE
        else analog_input(input_number(channel))
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
            channel.role: nominal_scale(table.model, input_number(channel), channel.range_v)
            for channel in analog
        }
    words = _calibration_words(control, table.model)
    scales: dict[Role, InputScale] = {}
    for channel in analog:
        scale = scale_from_flash(table.model, words, input_number(channel), channel.range_v)
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
