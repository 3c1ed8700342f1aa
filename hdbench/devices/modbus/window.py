"""The emulator of a polled device, told by registers that the profile's map leaves free."""

from __future__ import annotations

from collections.abc import Iterator

from hdbench.devices.modbus.access import Access
from hdbench.devices.modbus.layout import Place, place_of
from hdbench.errors import DeviceError, ProfileError
from hdbench.profile.acquiring_modbus import ModbusAcquisition, ModbusPlace

__all__ = ["SIGNATURE", "is_emulator", "window_start"]

# "HBEM": what the emulator's window begins with
SIGNATURE = 0x4842_454D
_WINDOW = 32
_HIGHEST, _STEP = 0xFF01, 0x100


def window_start(table: ModbusAcquisition) -> int:
    """Return where the emulator's window begins: the highest place that nothing else takes."""
    taken = [place_of(table, place) for place in _listed(table)]
    start = _HIGHEST
    while any(start - 2 * _WINDOW < place.start < start + _WINDOW for place in taken):
        start -= _STEP
    return start


def is_emulator(access: Access, table: ModbusAcquisition) -> bool:
    """Return whether hdbench's own emulator answers; a real device has nothing there."""
    try:
        return access.read([Place("holding", window_start(table), "u32", "ABCD", "signature")])[0] \
            == SIGNATURE  # fmt: skip
    except ProfileError:
        # refused: no such register
        return False
    except DeviceError:
        # a device that keeps silent about registers that it does not have
        return False


def _listed(table: ModbusAcquisition) -> Iterator[ModbusPlace]:
    """Yield every place that the profile lists."""
    yield from table.identify
    yield from table.init
    for channel in table.channels:
        yield channel
        yield from (word for word in (channel.status, channel.sign) if word is not None)
    output = table.output
    if output is None:
        return
    yield output
    if output.read_back is not None:
        yield output.read_back
    if output.enable is not None:
        yield output.enable
    watchdog = output.watchdog
    if watchdog is not None:
        yield from (watchdog.time, watchdog.tripped, *watchdog.clear)
        if watchdog.feed is not None:
            yield watchdog.feed
