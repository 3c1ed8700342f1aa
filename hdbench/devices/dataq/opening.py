"""Open the DATAQ instrument that a profile names."""

from __future__ import annotations

from hdbench.devices.dataq.abilities import max_rates_hz
from hdbench.devices.dataq.commands import Commands
from hdbench.devices.dataq.driver import DataqDaq
from hdbench.devices.dataq.port import Port, port_path
from hdbench.devices.dataq.scanlist import plan_scan
from hdbench.errors import UsageError
from hdbench.profile.acquiring import Acquisition
from hdbench.profile.acquiring_dataq import DataqAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["dataq_rate_hz", "open_dataq"]


def open_dataq(profile: ProfileData, table: Acquisition) -> DataqDaq:
    """Open the instrument; the port is not opened yet.

    Parameters
    ----------
    profile : ProfileData
        The bench.
    table : DataqAcquisition
        ``[daq]``, or one part of a composite, with the address of a port.

    Returns
    -------
    DataqDaq

    Raises
    ------
    ProfileError
        If the table asks for what the model does not have.
    UsageError
        If the table or its address is another driver's.
    """
    found = _own(table)
    plan_scan(found, tuple(channel.role for channel in found.channels))
    commands = Commands(Port(port_path(found.address)), deadline_s=found.deadline_s)
    return DataqDaq(commands, found)


def dataq_rate_hz(table: Acquisition) -> float:
    """Return the highest rate of the profile's channels, Hz, embedded or not.

    Parameters
    ----------
    table : DataqAcquisition
        ``[daq]``.

    Returns
    -------
    float
    """
    return max_rates_hz(_own(table))[-1]


def _own(table: Acquisition) -> DataqAcquisition:
    if not isinstance(table, DataqAcquisition):
        raise UsageError(
            f"the table of driver {table.driver!r} is none of dataq",
            where="key daq.driver",
            fix='set driver = "dataq"',
        )
    return table
