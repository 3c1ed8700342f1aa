"""An emulated LabJack and its ports."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.devices.emulator.instrument import SimulatedInstrument
from hdbench.devices.emulator.labjack.device import LabJackDevice
from hdbench.devices.emulator.labjack.server import STREAM_OFFSET, LabJackServer
from hdbench.devices.emulator.labjack.wiring import Wiring
from hdbench.devices.emulator.serve import EmulatorSettings
from hdbench.errors import DeviceError, UsageError
from hdbench.profile.acquiring import Acquisition
from hdbench.profile.acquiring_labjack import LabJackAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["LabJackPart", "labjack_part"]


class LabJackPart:
    """Implements `hdbench.devices.emulator.kinds.EmulatedPart`.

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


def labjack_part(
    instrument: SimulatedInstrument, profile: ProfileData, table: Acquisition, seed: int
) -> LabJackPart:
    """Return a device with the bench of `instrument` at the terminals that `table` names.

    Parameters
    ----------
    instrument : SimulatedInstrument
        The bench; another device may share it.
    profile : ProfileData
        Its profile.
    table : LabJackAcquisition
        ``[daq]``, or one part of a composite.
    seed : int
        Chooses serial number and constants of the device.

    Returns
    -------
    LabJackPart
        Not listening yet.

    Raises
    ------
    UsageError
        If the table is another driver's.
    """
    if not isinstance(table, LabJackAcquisition):
        raise UsageError(
            f"the profile's driver is {table.driver!r}; needed: labjack-t",
            where="key daq.driver",
            fix="name a profile with a LabJack, such as labjack-t7",
        )
    # the instrument's current channel has max_current_a at range_v; the terminal has 1 V per scale
    current = next((c for c in table.channels if c.role == "current"), None)
    amperes_per_v = profile.servo.max_current_a / profile.daq.range_v
    factor = 1.0 if current is None else amperes_per_v / current.scale
    wiring = Wiring(instrument, table, current_v_per_v=factor, seed=seed)
    return LabJackPart(LabJackDevice(wiring, serial_number(seed)))


def serial_number(seed: int) -> int:
    """Return the serial number that an emulated device has with this seed.

    Parameters
    ----------
    seed : int
        At least 0.

    Returns
    -------
    int
        1 to 999 999 999.
    """
    return seed % 999_999_999 + 1
