"""What a DATAQ instrument can do as the profile wires it."""

from __future__ import annotations

from hdbench.devices.daq import Capabilities, InputInfo
from hdbench.drivers.dataq.encoder import WRAP
from hdbench.drivers.dataq.models import MODELS
from hdbench.drivers.dataq.rates import BUFFER_SAMPLES, highest_rate_hz, lowest_rate_hz
from hdbench.drivers.dataq.scanlist import plan_scan
from hdbench.drivers.dataq.table import DataqAcquisition, DataqChannel

__all__ = ["describe_abilities", "max_rates_hz"]


def describe_abilities(table: DataqAcquisition, *, simulated: bool) -> Capabilities:
    """Return the abilities."""
    model = MODELS[table.model]
    roles = tuple(channel.role for channel in table.channels)
    entries = len(plan_scan(table, roles).words)
    return Capabilities(
        inputs=tuple(_input(channel, model.bits) for channel in table.channels),
        max_rates_hz=max_rates_hz(table),
        min_rate_hz=lowest_rate_hz(model, entries),
        outputs=(),
        generator=False,
        enable=False,
        buffered=True,
        buffer_scans=BUFFER_SAMPLES // entries,
        watchdog=None,
        simulated=simulated,
    )


def _input(channel: DataqChannel, bits: int) -> InputInfo:
    if channel.input == "counter":
        return InputInfo(channel.role, 0.0, WRAP - 1.0, 32, WRAP)
    end = channel.range_v * abs(channel.scale)
    return InputInfo(channel.role, -end, end, bits)


def max_rates_hz(table: DataqAcquisition) -> tuple[float, ...]:
    """Return the highest rate with the first 1, 2, ... channels, Hz, the mark included."""
    roles = tuple(channel.role for channel in table.channels)
    return tuple(
        highest_rate_hz(
            MODELS[table.model], len(plan_scan(table, roles[:count]).words), table.average
        )
        for count in range(1, len(roles) + 1)
    )
