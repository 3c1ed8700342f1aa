"""What a Modbus device can do as the profile describes it, the wire included."""

from __future__ import annotations

import math

from hdbench.devices.capabilities import Capabilities, OutputInfo, WatchdogInfo
from hdbench.devices.modbus.inputs import input_info
from hdbench.devices.modbus.layout import Block, place_of, plan_blocks
from hdbench.devices.modbus.outputs import output_range_v, output_step_v
from hdbench.devices.wire.address import parse_address, serial_settings
from hdbench.profile.acquiring_modbus import ModbusAcquisition

__all__ = ["describe_abilities", "exchange_s", "max_rates_hz", "reads_of"]

# a request to read: function, address, count; a reply: function, byte count, data
_REQUEST, _REPLY_HEAD = 5, 2
# around both on a serial line: unit and checksum
_ENVELOPE = 3
# a slower poll than once in ten minutes is no acquisition
_MIN_RATE_HZ = 1.0 / 600.0


def describe_abilities(table: ModbusAcquisition, *, simulated: bool) -> Capabilities:
    """Return the abilities."""
    output = table.output
    watchdog = None if output is None else output.watchdog
    write_s = 2.0 * exchange_s(table, 2)
    return Capabilities(
        inputs=tuple(input_info(table, channel) for channel in table.channels),
        max_rates_hz=max_rates_hz(table),
        min_rate_hz=_MIN_RATE_HZ,
        outputs=()
        if output is None
        else (OutputInfo("reference", *output_range_v(output), output_step_v(output), write_s),),
        generator=False,
        enable=output is not None and output.enable is not None,
        buffered=False,
        buffer_scans=0,
        watchdog=None
        if watchdog is None
        else WatchdogInfo(
            watchdog.min_s,
            watchdog.max_s,
            watchdog.unit_s,
            watchdog.fed_by,
            watchdog.drops,
            watchdog.latches,
        ),
        simulated=simulated,
    )


def max_rates_hz(table: ModbusAcquisition) -> tuple[float, ...]:
    """Return the highest rate with the first 1, 2, ... channels, Hz.

    Notes
    -----
    One reading takes the time of its requests on the wire, the device's own time ``reply_s`` for
    each, and ``min_gap_s`` between them. What the motor reference takes of the line - a write and
    a read-back every ``update_s`` - is left out of it. A device that renews its values
    ``refresh_hz`` times per second is not polled more often: it would say the same twice.
    """
    output = table.output
    taken = 0.0 if output is None else 2.0 * exchange_s(table, 2) / output.update_s
    rates = []
    for count in range(1, len(table.channels) + 1):
        reading_s = sum(exchange_s(table, block.reply_bytes) for block in reads_of(table, count))
        rate = max(0.0, 1.0 - taken) / reading_s if reading_s > 0.0 else math.inf
        rates.append(min(rate, table.refresh_hz or math.inf))
    return tuple(rates)


def exchange_s(table: ModbusAcquisition, data_bytes: int) -> float:
    """Return the time of one request and its reply, s."""
    sent, received = _REQUEST + _ENVELOPE, _REPLY_HEAD + data_bytes + _ENVELOPE
    line, wire_s = None if table.serial is None else serial_settings(table.serial), 0.0
    if table.address != "embedded":
        address = parse_address(table.address, line, default_port=502)
        line = address.serial if address.is_line else None
        if address.scheme == "ascii":
            # two characters for a byte, a shorter checksum, and what frames them
            sent, received = 2 * sent + 1, 2 * received + 1
    if line is not None:
        wire_s = line.exchange_s(sent, received)
    return wire_s + table.reply_s + table.min_gap_s


def reads_of(table: ModbusAcquisition, count: int | None = None) -> tuple[Block, ...]:
    """Return the requests of one reading."""
    channels = table.channels[:count]
    places = [place_of(table, channel) for channel in channels]
    places += [place_of(table, w) for c in channels for w in (c.status, c.sign) if w is not None]
    return plan_blocks(places, most=table.max_read_registers, bridge=table.bridge_registers)
