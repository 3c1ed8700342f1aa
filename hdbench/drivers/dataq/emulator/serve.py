"""An emulated DATAQ instrument and its line."""

from __future__ import annotations

from collections.abc import Mapping

from hdbench.devices.emulator.serving import Emulation, EmulatorSettings
from hdbench.drivers.dataq.emulator.device import DataqDevice
from hdbench.drivers.dataq.emulator.line import DataqLine
from hdbench.drivers.dataq.emulator.words import Terminal
from hdbench.drivers.dataq.models import MODELS
from hdbench.drivers.dataq.scanlist import channel_number
from hdbench.drivers.dataq.table import DataqAcquisition

__all__ = ["EmulatedDataq", "emulate_dataq"]

# fast pace: a host has less time for the same samples
_FAST_BUFFERS = 16


class EmulatedDataq:
    """Implements `hdbench.devices.emulator.serving.EmulatedDevice`.

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


def emulate_dataq(emulation: Emulation, table: DataqAcquisition) -> EmulatedDataq:
    """Return an instrument with a simulated bench at the terminals that `table` names."""
    # the instrument's current channel has max_current_a at range_v; the terminal has 1 V per scale
    profile = emulation.profile
    amperes_per_v = profile.servo.max_current_a / profile.daq.range_v
    wiring: dict[int, Terminal] = {}
    for channel in table.channels:
        if channel.role != "encoder":
            factor = amperes_per_v if channel.role == "current" else 1.0
            wiring[channel_number(channel)] = (channel.role, factor / channel.scale)
    serial = f"{emulation.seed % 16**8:08X}"
    return EmulatedDataq(DataqDevice(emulation.instrument, MODELS[table.model], wiring, serial))
