"""What a T4 or T7 can do as one profile wires it."""

from __future__ import annotations

from hdbench.devices.daq import Capabilities, InputInfo, OutputInfo, WatchdogInfo
from hdbench.drivers.labjack.outputs import output_range_v, output_step_v
from hdbench.drivers.labjack.registers import BUFFER_SIZE
from hdbench.drivers.labjack.scaling import InputScale
from hdbench.drivers.labjack.scanlist import QUADRATURE, plan_scan
from hdbench.drivers.labjack.table import LabJackAcquisition, LabJackChannel

__all__ = ["describe_abilities"]

# samples per second of all channels together (labjack.com, T-series data sheet, 3.2)
_SAMPLES_HZ = {"T7": 100_000.0, "T4": 50_000.0}
_BITS = {"T7": 16, "T4": 12}
_MIN_RATE_HZ = 0.02
# one update of an output over Ethernet (labjack.com, T7 data sheet, appendix A-1)
_WRITE_S = 0.0011


def describe_abilities(table: LabJackAcquisition, *, simulated: bool) -> Capabilities:
    """Return the abilities.

    Notes
    -----
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
        buffered=True,
        buffer_scans=BUFFER_SIZE // (2 * words[-1]),
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
