"""Abilities of a T4 or T7 as a profile wires it, and a table checked against them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from hdbench.devices.daq import Capabilities, InputInfo, OutputInfo, WatchdogInfo
from hdbench.drivers.labjack.outputs import output_range_v, output_step_v
from hdbench.drivers.labjack.scanlist import (
    QUADRATURE,
    T7_RANGES_V,
    InputScale,
    input_number,
    plan_scan,
    quadrature_lines,
)
from hdbench.drivers.labjack.table import LabJackAcquisition, LabJackChannel
from hdbench.errors import ProfileError

_T4_HIGH_V = 10.0
_T4_HIGH_INPUTS = 4
# single-ended inputs of the device itself; above them are those of multiplexer boards
_T7_INPUTS = 14
_T7_DIFFERENTIAL = range(0, 13, 2)


def check_table(table: LabJackAcquisition) -> None:
    """Refuse a table that the model cannot carry out."""
    problems = [*_model_problems(table)]
    for channel in table.channels:
        problems += _channel_problems(table.model, channel)
    problems += [*_role_problems(table), *_line_problems(table)]
    if problems:
        errors = tuple(
            ProfileError(what, where=f"key daq.{key}", fix=fix) for key, what, fix in problems
        )
        raise ProfileError(
            errors[0].what, where=errors[0].where, fix=errors[0].fix, problems=errors
        )


_Problem = tuple[str, str, str]


def _model_problems(table: LabJackAcquisition) -> Iterator[_Problem]:
    if table.model == "T4" and not table.auto_recover:
        yield "auto_recover", "a T4 always goes on after a full buffer", "set it to true"
    if table.model not in ("T4", "T7"):
        what = f"{table.model} is not supported: how its streamed words become volts is published "
        what += "only as part of its maker's library"
        yield "model", what, 'use model = "T7" or "T4"'


def _role_problems(table: LabJackAcquisition) -> Iterator[_Problem]:
    for role, count in Counter(channel.role for channel in table.channels).items():
        if count > 1:
            what = f"{count} channels have the role {role}"
            yield "channels", what, "give each role to one channel"
    if all(channel.input == QUADRATURE for channel in table.channels):
        what = "no analog input; the stream needs one"
        yield "channels", what, "add the torque channel"


def _channel_problems(model: str, channel: LabJackChannel) -> Iterator[_Problem]:
    key = f"channels (role {channel.role})"
    if (channel.input == QUADRATURE) != (channel.role == "encoder"):
        yield key, f"{channel.input} as {channel.role}", "quadrature is for the encoder alone"
        return
    if channel.input == QUADRATURE:
        return
    number, range_v, negative = input_number(channel), channel.range_v, channel.negative
    if model == "T4":
        if not (number < _T4_HIGH_INPUTS and range_v == _T4_HIGH_V):
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
        taken.update(dict.fromkeys(quadrature_lines(table.model), "the encoder"))
    if output.output.startswith("TDAC"):
        first = int(output.output.removeprefix("TDAC")) // 2 * 2
        if first in taken or first + 1 in taken:
            what = f"{output.output} needs DIO{first} and DIO{first + 1}, which the encoder has"
            yield "output.output", what, "plug the LJTick-DAC into another pair of lines"
        taken.update(dict.fromkeys((first, first + 1), "the LJTick-DAC"))
    line = output.enable_line
    if line in taken:
        yield "output.enable_line", f"DIO{line} belongs to {taken[line]}", "use a free line"
    if table.model == "T4" and line < _T4_HIGH_INPUTS:
        what = f"DIO{line} of a T4 is an analog input"
        yield "output.enable_line", what, "use DIO4 or above"


# samples per second of all channels together (labjack.com, T-series data sheet, 3.2)
_SAMPLES_HZ = {"T7": 100_000.0, "T4": 50_000.0}
_BITS = {"T7": 16, "T4": 12}
_MIN_RATE_HZ = 0.02
# one update of an output over Ethernet (labjack.com, T7 data sheet, appendix A-1)
_WRITE_S = 0.0011


def describe_abilities(table: LabJackAcquisition, *, simulated: bool) -> Capabilities:
    """Return the abilities.

    The highest rate is the data sheet's total divided by the words of a scan. What a small input
    range or a high resolution takes from it is not published in a form that was checked; the device
    itself ends a stream that cannot keep its rate (SCAN_OVERLAP).
    """
    words = [_words(table, count) for count in range(1, len(table.channels) + 1)]
    output = table.output
    return Capabilities(
        inputs=tuple(_input(channel, table.model) for channel in table.channels),
        max_rates_hz=tuple(_SAMPLES_HZ[table.model] / count for count in words),
        min_rate_hz=_MIN_RATE_HZ,
        outputs=()
        if output is None
        else (
            OutputInfo(
                "reference",
                *output_range_v(output),
                output_step_v(output, table.model),
                _WRITE_S,
            ),
        ),
        generator=False,
        enable=output is not None,
        watchdog=None if output is None else _watchdog(output.output),
        simulated=simulated,
    )


def _watchdog(output: str) -> WatchdogInfo:
    drops = ("enable",) if output.startswith("TDAC") else ("reference", "enable")
    return WatchdogInfo(min_s=1.0, max_s=5.0, step_s=1.0, fed_by="key", drops=drops, latches=False)


def _input(channel: LabJackChannel, model: str) -> InputInfo:
    if channel.input == QUADRATURE:
        return InputInfo(channel.role, -(2.0**31), 2.0**31 - 1.0, 32, 2**32)
    end = channel.range_v * abs(channel.scale)
    return InputInfo(channel.role, -end, end, _BITS[model])


def _words(table: LabJackAcquisition, count: int) -> int:
    roles = tuple(channel.role for channel in table.channels[:count])
    scale = InputScale(0.0, 1.0, -1.0, "nominal")
    return len(plan_scan(table, roles, dict.fromkeys(roles, scale)).addresses)
