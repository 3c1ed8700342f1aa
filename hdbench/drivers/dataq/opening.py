"""The driver of DATAQ instruments."""

from __future__ import annotations

import time

from hdbench.devices.daq import clean_text
from hdbench.drivers.dataq.abilities import max_rates_hz
from hdbench.drivers.dataq.commands import Commands
from hdbench.drivers.dataq.driver import DataqDaq
from hdbench.drivers.dataq.port import Port, port_path
from hdbench.drivers.dataq.scanlist import plan_scan
from hdbench.drivers.dataq.table import DataqAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["dataq_rate_hz", "open_dataq", "probe", "verify"]

_PROBE_S = 0.3


def open_dataq(profile: ProfileData, table: DataqAcquisition) -> DataqDaq:
    """Open the instrument; the port is not opened yet."""
    return DataqDaq(Commands(Port(port_path(table.address)), deadline_s=table.deadline_s), table)


def dataq_rate_hz(table: DataqAcquisition) -> float:
    """Return the highest rate of the profile's channels, Hz, embedded or not."""
    return max_rates_hz(table)[-1]


def verify(table: DataqAcquisition) -> None:
    """Refuse what the model does not have."""
    plan_scan(table, tuple(channel.role for channel in table.channels))


def probe(path: str) -> str:
    """Ask ``info 1``: a DATAQ echoes the words and adds its model."""
    from serial import Serial

    with Serial(path, 115200, timeout=0.05, exclusive=True) as line:
        line.reset_input_buffer()
        line.write(b"info 1\r")
        until_s, reply = time.monotonic() + _PROBE_S, b""
        while time.monotonic() < until_s and len(reply) < 64:
            reply += line.read(64)
    said = clean_text(reply.replace(b"\r", b" "))
    return f"DATAQ: {said.removeprefix('info 1').strip()}" if said.startswith("info 1 ") else ""
