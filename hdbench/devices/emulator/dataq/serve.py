"""An emulated DATAQ instrument and its line."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.devices.dataq.models import MODELS
from hdbench.devices.dataq.scanlist import channel_number
from hdbench.devices.emulator.dataq.device import DataqDevice
from hdbench.devices.emulator.dataq.line import DataqLine
from hdbench.devices.emulator.dataq.words import Terminal
from hdbench.devices.emulator.instrument import SimulatedInstrument
from hdbench.devices.emulator.serve import EmulatorSettings
from hdbench.errors import UsageError
from hdbench.profile.acquiring import Acquisition
from hdbench.profile.acquiring_dataq import DataqAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["DataqPart", "dataq_part"]

# fast pace: a host has less time for the same samples
_FAST_BUFFERS = 16


class DataqPart:
    """Implements `hdbench.devices.emulator.kinds.EmulatedPart`.

    Parameters
    ----------
    device : DataqDevice
        The instrument.
    """

    def __init__(self, device: DataqDevice) -> None:
        self.line = DataqLine(device)

    async def open(self, settings: EmulatorSettings) -> Mapping[str, object]:
        """Open the pseudo-terminal and return ``address``; it has no port to choose."""
        if settings.pace == "fast":
            self.line.device.buffer_samples *= _FAST_BUFFERS
        return {"address": await self.line.open()}

    def close(self) -> None:
        """End the line."""
        self.line.close()


def dataq_part(
    instrument: SimulatedInstrument, profile: ProfileData, table: Acquisition, seed: int
) -> DataqPart:
    """Return an instrument with the bench of `instrument` at the terminals that `table` names.

    Parameters
    ----------
    instrument : SimulatedInstrument
        The bench; another device may share it.
    profile : ProfileData
        Its profile.
    table : DataqAcquisition
        ``[daq]``, or one part of a composite.
    seed : int
        Shown as the serial number.

    Returns
    -------
    DataqPart

    Raises
    ------
    UsageError
        If the table is another driver's.
    """
    if not isinstance(table, DataqAcquisition):
        raise UsageError(
            f"the profile's driver is {table.driver!r}; needed: dataq",
            where="key daq.driver",
            fix="name a profile with a DATAQ instrument, such as di-2108-ek9000",
        )
    # the instrument's current channel has max_current_a at range_v; the terminal has 1 V per scale
    amperes_per_v = profile.servo.max_current_a / profile.daq.range_v
    wiring: dict[int, Terminal] = {}
    for channel in table.channels:
        if channel.role != "encoder":
            factor = amperes_per_v if channel.role == "current" else 1.0
            wiring[channel_number(channel)] = (channel.role, factor / channel.scale)
    device = DataqDevice(instrument, MODELS[table.model], wiring, f"{seed % 16**8:08X}")
    return DataqPart(device)
