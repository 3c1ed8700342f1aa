"""Run an emulated LabJack: in a process of its own for one session, or as a command."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from hdbench.devices.emulator.instrument import SimulatedInstrument
from hdbench.devices.emulator.labjack.device import LabJackDevice
from hdbench.devices.emulator.labjack.server import STREAM_OFFSET, LabJackServer
from hdbench.devices.emulator.labjack.wiring import Wiring
from hdbench.devices.emulator.serve import EmulatorSettings
from hdbench.devices.emulator.serving import serve_part
from hdbench.errors import DeviceError, UsageError
from hdbench.profile.acquiring import Acquisition
from hdbench.profile.acquiring_labjack import LabJackAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["FAST_SPEED", "LabJackPart", "emulate_labjack", "labjack_part"]

# fast pace: device seconds per second. The host writes the reference every few milliseconds of
# device time; at this speed that is a millisecond of real time, what two cores still keep.
FAST_SPEED = 5.0


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


def emulate_labjack(
    profile: ProfileData,
    plant: str,
    seed: int,
    settings: EmulatorSettings,
    *,
    ready: Callable[[Mapping[str, object]], None],
    model_file: Path | None = None,
) -> None:
    """Serve an emulated device until SIGTERM, Ctrl-C or the end of the lifeline.

    Parameters
    ----------
    profile : ProfileData
        The bench; its ``[daq]`` is a labjack-t.
    plant : str
        Name or path of the plant.
    seed : int
        Seed of everything simulated, at least 0.
    settings : EmulatorSettings
        Where and how; the stream listens 200 ports above the other.
    ready : callable
        Called once with the keys of ``[daq]`` as the device has them, and with ``speed``.
    model_file : Path, optional
        Refused: a host-written reference does not tell the whole motion beforehand.

    Raises
    ------
    UsageError
        If the profile has another driver.
    ProfileError
        If the plant is invalid.
    DeviceError
        If the ports cannot be used.
    StorageError
        If the record file cannot be written.
    """
    speed = FAST_SPEED if settings.pace == "fast" else 1.0
    serve_part(
        labjack_part,
        profile,
        plant,
        seed,
        settings,
        ready=ready,
        speed=speed,
        model_file=model_file,
    )
