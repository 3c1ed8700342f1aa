"""An emulated Modbus device and its wire."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.devices.emulator.modbus.device import ModbusDevice
from hdbench.devices.emulator.server import ModbusServer
from hdbench.devices.emulator.serving import Emulation, EmulatorSettings
from hdbench.profile.acquiring_modbus import ModbusAcquisition

__all__ = ["EmulatedModbus", "emulate_modbus"]


class EmulatedModbus:
    """Implements `hdbench.devices.emulator.serving.EmulatedDevice`.

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


def emulate_modbus(emulation: Emulation, table: ModbusAcquisition) -> EmulatedModbus:
    """Return a device with the registers of `table` and a simulated bench behind them."""
    # the instrument's current channel has max_current_a at range_v
    profile = emulation.profile
    amperes_per_v = profile.servo.max_current_a / profile.daq.range_v
    device = ModbusDevice(emulation.instrument, table, amperes_per_v=amperes_per_v)
    return EmulatedModbus(device, rtu=table.serial is not None)
