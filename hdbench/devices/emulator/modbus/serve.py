"""An emulated Modbus device and its wire."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.devices.emulator.instrument import SimulatedInstrument
from hdbench.devices.emulator.modbus.device import ModbusDevice
from hdbench.devices.emulator.serve import EmulatorSettings
from hdbench.devices.emulator.server import ModbusServer
from hdbench.errors import UsageError
from hdbench.profile.acquiring import Acquisition
from hdbench.profile.acquiring_modbus import ModbusAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["ModbusPart", "modbus_part"]


class ModbusPart:
    """Implements `hdbench.devices.emulator.kinds.EmulatedPart`.

    Parameters
    ----------
    device : ModbusDevice
        The device.
    rtu : bool
        Whether it is on a serial line: its table has ``[daq.serial]``.
    """

    def __init__(self, device: ModbusDevice, *, rtu: bool) -> None:
        self.device = device
        self._rtu = rtu
        self._server: ModbusServer | None = None

    async def open(self, settings: EmulatorSettings) -> Mapping[str, object]:
        """Open the wire and return ``address``."""
        wire = "rtu" if self._rtu and settings.wire == "tcp" else settings.wire
        self._server = ModbusServer(self.device, wire)
        return {"address": await self._server.open(settings.host, settings.port)}

    def close(self) -> None:
        """Close the wire."""
        if self._server is not None:
            self._server.close()


def modbus_part(
    instrument: SimulatedInstrument, profile: ProfileData, table: Acquisition, seed: int
) -> ModbusPart:
    """Return a device with the registers of `table` and the bench of `instrument` behind them.

    Parameters
    ----------
    instrument : SimulatedInstrument
        The bench; another device may share it.
    profile : ProfileData
        Its profile.
    table : ModbusAcquisition
        ``[daq]``, or one part of a composite.
    seed : int
        Not used: such a device has no constants of its own.

    Returns
    -------
    ModbusPart

    Raises
    ------
    UsageError
        If the table is another driver's.
    """
    if not isinstance(table, ModbusAcquisition):
        raise UsageError(
            f"the profile's driver is {table.driver!r}; needed: modbus",
            where="key daq.driver",
            fix="name a profile with a Modbus device, such as seneca-z-sg",
        )
    # the instrument's current channel has max_current_a at range_v
    amperes_per_v = profile.servo.max_current_a / profile.daq.range_v
    device = ModbusDevice(instrument, table, amperes_per_v=amperes_per_v)
    return ModbusPart(device, rtu=table.serial is not None)
