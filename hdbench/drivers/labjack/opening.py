"""Open the LabJack that a profile names."""

from __future__ import annotations

import math

from hdbench.devices.wire import connect, parse_address
from hdbench.drivers.labjack.abilities import describe_abilities
from hdbench.drivers.labjack.control import Control
from hdbench.drivers.labjack.driver import LabJackDaq
from hdbench.drivers.labjack.table import LabJackAcquisition
from hdbench.errors import UsageError
from hdbench.profile.schema import ProfileData

__all__ = ["STREAM_OFFSET", "labjack_rate_hz", "open_labjack"]

# 502 and 702
STREAM_OFFSET = 200


def open_labjack(profile: ProfileData, table: LabJackAcquisition) -> LabJackDaq:
    """Open the device; nothing is connected or written yet."""
    address = parse_address(table.address, default_port=502)
    if address.scheme != "tcp":
        raise UsageError(
            f"{table.address!r}: a LabJack is reached by tcp://HOST[:PORT]",
            where="key daq.address",
            fix="for example tcp://192.168.0.7",
        )
    port = address.port + STREAM_OFFSET if table.stream_port is None else table.stream_port
    return LabJackDaq(
        Control(connect(address), deadline_s=table.deadline_s),
        table,
        (address.host, port),
        tacho_rad_s_per_v=profile.tacho.gain_rad_s_per_v,
    )


def labjack_rate_hz(table: LabJackAcquisition) -> float:
    """Return the highest scan rate of the table's channels."""
    if table.model == "T8":
        return math.inf
    return describe_abilities(table, simulated=False).max_rates_hz[-1]
