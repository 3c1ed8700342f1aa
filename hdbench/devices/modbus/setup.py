"""Settings of the device: read first, written only where they differ, then read back."""

from __future__ import annotations

from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.layout import place_of
from hdbench.devices.modbus.values import encode
from hdbench.errors import DeviceError
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusWrite

__all__ = ["set_up"]


def set_up(access: Access, table: ModbusAcquisition) -> int:
    """Bring the device to the settings of ``[[daq.init]]``."""
    written = 0
    for write in table.init:
        place = place_of(table, write)
        if write.read_back and _same(write, access.read([place])[0]):
            continue
        access.write(place, write.value, write.function)
        written += 1
        if not write.read_back:
            continue
        found = access.read([place])[0]
        if not _same(write, found):
            raise DeviceError(
                f"reads back as {found:.9g}; written: {write.value:.9g}",
                where=f"{access.where}, {place.name}",
                fix="compare daq.init with the device's manual; a command register has "
                "read_back = false",
            )
    return written


def _same(write: ModbusWrite, found: float | int) -> bool:
    """Return whether a value is the one to be written, as its registers hold it."""
    if write.table == "coil":
        return bool(found) == bool(write.value)
    try:
        wanted = encode(write.value, write.type, "ABCD")
        return encode(found, write.type, "ABCD") == wanted
    except ValueError:
        return False
