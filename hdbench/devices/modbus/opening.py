"""Open the Modbus device that a profile describes."""

from __future__ import annotations

import math

from hdbench.devices.modbus.abilities import exchange_s, max_rates_hz, reads_of
from hdbench.devices.modbus.access import QUIET_S, TRY, Access
from hdbench.devices.modbus.driver import ModbusDaq
from hdbench.devices.modbus.links import polled_link
from hdbench.devices.modbus.probe import make_probe
from hdbench.devices.wire import parse_address
from hdbench.devices.wire.address import serial_settings
from hdbench.errors import ProfileError
from hdbench.profile.acquiring_modbus import ModbusAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["modbus_rate_hz", "open_modbus"]


def open_modbus(profile: ProfileData, table: ModbusAcquisition) -> ModbusDaq:
    """Open the device; nothing is connected or written yet."""
    given = None if table.serial is None else serial_settings(table.serial)
    address = parse_address(table.address, given, default_port=502)
    if not address.is_numbered:
        _check_deadline(table)
    probe = make_probe(table)
    link = polled_link(address, unit=table.unit, probe=probe, tls=table.tls)
    access = Access(
        link,
        deadline_s=table.deadline_s,
        probe=None if address.is_numbered else probe,
        numbered=address.is_numbered,
        min_gap_s=table.min_gap_s,
        max_registers=table.max_read_registers,
        bridge=table.bridge_registers,
    )
    return ModbusDaq(access, table)


def modbus_rate_hz(table: ModbusAcquisition) -> float:
    """Return the highest rate of the profile's channels, Hz."""
    rates = max_rates_hz(table)
    return rates[-1] if rates else math.inf


def _check_deadline(table: ModbusAcquisition) -> None:
    """Refuse a deadline whose tries are too short: a quiet line, a probe, a read, a probe."""
    longest = max((block.reply_bytes for block in reads_of(table)), default=2)
    needed_s = (QUIET_S + 3.0 * exchange_s(table, longest)) / TRY
    if not table.deadline_s >= needed_s:
        raise ProfileError(
            f"{table.deadline_s:g} s; on this line a lost frame is got over within "
            f"{needed_s:.2g} s",
            where="key daq.deadline_s",
            fix=f"set it to {needed_s:.2g} s or more",
        )
