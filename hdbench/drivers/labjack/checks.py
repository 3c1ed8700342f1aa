"""What a T4 or T7 does not have, told before it is opened."""

from __future__ import annotations

from collections import Counter

from hdbench.drivers.labjack.scaling import T7_RANGES_V
from hdbench.drivers.labjack.scanlist import QUADRATURE, input_number, quadrature_lines
from hdbench.drivers.labjack.table import LabJackAcquisition, LabJackChannel
from hdbench.errors import ProfileError

__all__ = ["check_table"]

_T4_HIGH_V = 10.0
_T4_HIGH_INPUTS = 4
# single-ended inputs of the device itself; above them are those of multiplexer boards
_T7_INPUTS = 14
_T7_DIFFERENTIAL = range(0, 13, 2)


def check_table(table: LabJackAcquisition) -> None:
    """Refuse a table that the model cannot carry out."""
    problems = [
        *_model_problems(table),
        *(problem for channel in table.channels for problem in _channel_problems(table, channel)),
        *_role_problems(table),
        *_line_problems(table),
    ]
    if problems:
        errors = tuple(
            ProfileError(what, where=f"key daq.{key}", fix=fix) for key, what, fix in problems
        )
        raise ProfileError(
            errors[0].what, where=errors[0].where, fix=errors[0].fix, problems=errors
        )


_Problem = tuple[str, str, str]


def _model_problems(table: LabJackAcquisition) -> list[_Problem]:
    if table.model == "T4" and not table.auto_recover:
        return [("auto_recover", "a T4 always goes on after a full buffer", "set it to true")]
    if table.model in ("T4", "T7"):
        return []
    return [
        (
            "model",
            f"{table.model} is not supported: how its streamed words become volts is published "
            "only as part of its maker's library",
            'use model = "T7" or "T4"',
        )
    ]


def _role_problems(table: LabJackAcquisition) -> list[_Problem]:
    counts = Counter(channel.role for channel in table.channels)
    problems = [
        ("channels", f"{count} channels have the role {role}", "give each role to one channel")
        for role, count in counts.items()
        if count > 1
    ]
    if all(channel.input == QUADRATURE for channel in table.channels):
        problems.append(
            ("channels", "no analog input; the stream needs one", "add the torque channel")
        )
    return problems


def _channel_problems(table: LabJackAcquisition, channel: LabJackChannel) -> list[_Problem]:
    key = f"channels (role {channel.role})"
    if (channel.input == QUADRATURE) != (channel.role == "encoder"):
        return [(key, f"{channel.input} as {channel.role}", "quadrature is for the encoder alone")]
    if channel.input == QUADRATURE:
        return []
    return _t4_problems(key, channel) if table.model == "T4" else _t7_problems(key, channel)


def _t7_problems(key: str, channel: LabJackChannel) -> list[_Problem]:
    number = input_number(channel)
    problems: list[_Problem] = []
    if number >= _T7_INPUTS:
        problems.append((key, f"AIN{number}; a T7 has AIN0 to AIN13", "use one of those"))
    if channel.range_v not in T7_RANGES_V:
        problems.append(
            (key, f"range_v {channel.range_v:g} V; a T7 has 10, 1, 0.1, 0.01 V", "use one of those")
        )
    if channel.negative is not None and not (
        number in _T7_DIFFERENTIAL and channel.negative == number + 1
    ):
        problems.append(
            (
                key,
                f"AIN{number} against AIN{channel.negative}; a T7 takes an even input against the "
                "next one, up to AIN12",
                "wire it so, or leave negative out",
            )
        )
    return problems


def _t4_problems(key: str, channel: LabJackChannel) -> list[_Problem]:
    number = input_number(channel)
    problems: list[_Problem] = []
    if not (number < _T4_HIGH_INPUTS and channel.range_v == _T4_HIGH_V):
        problems.append(
            (
                key,
                f"AIN{number} with +-{channel.range_v:g} V; a bench needs both signs, which a T4 "
                "has on AIN0 to AIN3 with +-10 V only",
                "use AIN0 to AIN3 and range_v = 10.0",
            )
        )
    if channel.negative is not None:
        problems.append((key, "a T4 has no differential inputs", "leave negative out"))
    return problems


def _line_problems(table: LabJackAcquisition) -> list[_Problem]:
    output = table.output
    if output is None:
        return []
    taken: dict[int, str] = {}
    if any(channel.input == QUADRATURE for channel in table.channels) and table.model != "T8":
        taken.update(dict.fromkeys(quadrature_lines(table.model), "the encoder"))
    problems: list[_Problem] = []
    if output.output.startswith("TDAC"):
        first = int(output.output.removeprefix("TDAC")) // 2 * 2
        if first in taken or first + 1 in taken:
            problems.append(
                (
                    "output.output",
                    f"{output.output} needs DIO{first} and DIO{first + 1}, which {taken[first]} has"
                    if first in taken
                    else f"{output.output} needs a line of the encoder",
                    "plug the LJTick-DAC into another pair of lines",
                )
            )
        taken.update(dict.fromkeys((first, first + 1), "the LJTick-DAC"))
    if output.enable_line in taken:
        problems.append(
            (
                "output.enable_line",
                f"DIO{output.enable_line} belongs to {taken[output.enable_line]}",
                "use a free line",
            )
        )
    if table.model == "T4" and output.enable_line < _T4_HIGH_INPUTS:
        problems.append(
            (
                "output.enable_line",
                f"DIO{output.enable_line} of a T4 is an analog input",
                "use DIO4 or above",
            )
        )
    return problems
