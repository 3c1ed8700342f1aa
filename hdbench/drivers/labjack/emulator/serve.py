"""An emulated LabJack and its ports."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.devices.emulator.serving import Emulation, EmulatorSettings
from hdbench.drivers.labjack.emulator.device import LabJackDevice
from hdbench.drivers.labjack.emulator.server import STREAM_OFFSET, LabJackServer
from hdbench.drivers.labjack.emulator.wiring import Wiring
from hdbench.drivers.labjack.table import LabJackAcquisition
from hdbench.errors import DeviceError

__all__ = ["EmulatedLabJack", "emulate_labjack"]


class EmulatedLabJack:
    """Implements `hdbench.devices.emulator.serving.EmulatedDevice`.

    Parameters
    ----------
    device : LabJackDevice
        The device.
    """

    def __init__(self, device: LabJackDevice) -> None:
        self.server = LabJackServer(device)

    async def open(self, settings: EmulatorSettings) -> Mapping[str, object]:
        """Listen on a pair of ports; return ``address`` and ``stream_port``."""
        try:
            host, port = await self.server.open(settings.host, settings.port)
        except OSError as error:
            raise DeviceError(
                f"cannot listen on ports {settings.port} and {settings.port + STREAM_OFFSET} "
                f"({error.strerror or error})",
                where=f"{settings.host}:{settings.port}",
                fix="choose another port, or 0 for a free pair",
            ) from error
        return {"address": f"tcp://{host}:{port}", "stream_port": port + STREAM_OFFSET}

    def close(self) -> None:
        """Stop listening and end every connection."""
        self.server.close()


def emulate_labjack(emulation: Emulation, table: LabJackAcquisition) -> EmulatedLabJack:
    """Return a device with a simulated bench at the terminals that `table` names."""
    # the instrument's current channel has max_current_a at range_v; the terminal has 1 V per scale
    profile = emulation.profile
    current = next((c for c in table.channels if c.role == "current"), None)
    amperes_per_v = profile.servo.max_current_a / profile.daq.range_v
    factor = 1.0 if current is None else amperes_per_v / current.scale
    wiring = Wiring(emulation.instrument, table, current_v_per_v=factor, seed=emulation.seed)
    return EmulatedLabJack(LabJackDevice(wiring, serial_number(emulation.seed)))


def serial_number(seed: int) -> int:
    """Return the serial number that an emulated device has with this seed."""
    return seed % 999_999_999 + 1
