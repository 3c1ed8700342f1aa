"""Open the LabJack that a profile names."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from hdbench.devices.driver import Driver
from hdbench.devices.wire import connect, parse_address
from hdbench.drivers.labjack.abilities import describe_abilities
from hdbench.drivers.labjack.checks import check_table
from hdbench.drivers.labjack.control import Control
from hdbench.drivers.labjack.driver import LabJackDaq
from hdbench.drivers.labjack.table import LabJackAcquisition
from hdbench.errors import UsageError
from hdbench.profile.schema import ProfileData

if TYPE_CHECKING:
    from hdbench.devices.emulator.serving import EmulatedDevice, Emulation
    from hdbench.devices.guard.order import Target

__all__ = ["DRIVER", "STREAM_OFFSET", "labjack_rate_hz", "open_labjack"]

# 502 and 702
STREAM_OFFSET = 200


def open_labjack(profile: ProfileData, table: LabJackAcquisition) -> LabJackDaq:
    """Open the device; nothing is connected or written yet.

    Parameters
    ----------
    profile : ProfileData
        The bench.
    table : LabJackAcquisition
        ``[daq]``, with the address of a device.

    Returns
    -------
    LabJackDaq

    Raises
    ------
    UsageError
        If the address is another driver's.
    """
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
    """Return the highest scan rate of the table's channels.

    Parameters
    ----------
    table : LabJackAcquisition
        ``[daq]`` of the profile.

    Returns
    -------
    float
        Hz; inf for what this driver refuses with a reason of its own.
    """
    if table.model == "T8":
        return math.inf
    return describe_abilities(table, simulated=False).max_rates_hz[-1]


def _stop_target(profile: ProfileData, table: LabJackAcquisition) -> Target | None:
    from hdbench.drivers.labjack.stopping import stop_target

    return stop_target(profile, table)


def _emulate(emulation: Emulation, table: LabJackAcquisition) -> EmulatedDevice:
    from hdbench.drivers.labjack.emulator.serve import emulate_labjack

    return emulate_labjack(emulation, table)


DRIVER = Driver(
    open=open_labjack,
    verify=check_table,
    rate_hz=labjack_rate_hz,
    drives=lambda table: table.output is not None,
    stop_target=_stop_target,
    emulate=_emulate,
    # the host writes the reference every millisecond of real time then, what two cores still keep
    emulated_speed=5.0,
)
