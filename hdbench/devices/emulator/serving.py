"""Serve emulated instruments around one simulated bench: in a session, or as a command."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

from hdbench.devices.emulator.bench import SimulatedBench
from hdbench.devices.emulator.channel import Channel
from hdbench.devices.emulator.instrument import DeviceClock, SimulatedInstrument
from hdbench.devices.emulator.kinds import EmulatedPart, part_of
from hdbench.devices.emulator.lifetime import ending, open_record, until_motor_stands
from hdbench.devices.emulator.machine import Pace
from hdbench.devices.emulator.plantfile import load_plant
from hdbench.devices.emulator.serve import EmulatorSettings
from hdbench.errors import DeviceError, UsageError
from hdbench.profile.acquiring import Acquisition, CompositeAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["emulate_instruments", "emulated_speed"]

# Fast pace: device seconds per second. The host writes the reference every few milliseconds of
# device time; of a LabJack that is a millisecond of real time, what two cores still keep. A polled
# device has the host's time at any pace.
_FAST_SPEEDS = {"labjack-t": 5.0, "modbus": 1.0, "dataq": 10.0}
# that a host-written reference and two wires keep up with
_FAST_COMPOSITE = 4.0
# time in which devices that have lost their host must have stopped the motor: watchdog and braking
_ORPHAN_S = 7.0


def emulate_instruments(
    profile: ProfileData,
    plant: str,
    seed: int,
    settings: EmulatorSettings,
    *,
    ready: Callable[[Mapping[str, object]], None],
    model_file: Path | None = None,
) -> None:
    """Serve one device, or both of a composite, until SIGTERM, Ctrl-C or the lifeline's end.

    Parameters
    ----------
    profile : ProfileData
        The bench; its ``[daq]`` names the devices.
    plant : str
        Name or path of the plant.
    seed : int
        Seed of everything simulated, at least 0.
    settings : EmulatorSettings
        Where and how; of a composite the port is the first one's, the others are free ones.
    ready : callable
        Called once with the keys of ``[daq]`` as the device has them - of a composite ``inputs``
        and ``outputs``, each with its keys -, ``speed`` and
        ``control``, the address of the simulated operator's channel.
    model_file : Path, optional
        Refused: a host-written reference does not tell the whole motion beforehand.

    Raises
    ------
    UsageError
        If a model file is given, or a device has no emulator.
    ProfileError
        If the plant is invalid.
    DeviceError, StorageError
        If a wire or the record file cannot be used.
    """
    if model_file is not None:
        raise UsageError(
            "an extended model needs the whole motion beforehand; this device's reference is "
            "written by its host as it goes",
            where="--model",
            fix="emulate the profile's own model, or a node",
        )
    speed = emulated_speed(profile.daq, settings.pace)
    with ExitStack() as stack:
        instrument = SimulatedInstrument(
            SimulatedBench(profile, load_plant(plant), seed),
            profile.encoder.counts_per_turn,
            clock=DeviceClock(speed, time.monotonic()),
            record=open_record(settings.record, stack),
        )
        parts = {
            name: part_of(table.driver)(instrument, profile, table, seed)
            for name, table in _tables(profile.daq).items()
        }

        def opened(found: Mapping[str, Mapping[str, object]], control: str) -> None:
            keys = found.get("", {"address": "parts", **found})
            ready({**keys, "speed": speed, "control": control})

        asyncio.run(_serve(instrument, parts, settings, opened))


def emulated_speed(table: Acquisition, pace: Pace) -> float:
    """Return how many device seconds pass in a second.

    Parameters
    ----------
    table : Acquisition
        ``[daq]``.
    pace : {"realtime", "fast"}
        What was asked for.

    Returns
    -------
    float
        1 with polled inputs at any pace: they are read by this computer's clock.
    """
    composite = isinstance(table, CompositeAcquisition)
    sampling = table.inputs if isinstance(table, CompositeAcquisition) else table
    speed = _FAST_SPEEDS.get(sampling.driver, 1.0) if pace == "fast" else 1.0
    return min(speed, _FAST_COMPOSITE) if composite else speed


def _tables(table: Acquisition) -> dict[str, Acquisition]:
    """Return the devices of a table by their keys in it; a single one has none."""
    if isinstance(table, CompositeAcquisition):
        return {"inputs": table.inputs, "outputs": table.outputs}
    return {"": table}


async def _serve(
    instrument: SimulatedInstrument,
    parts: Mapping[str, EmulatedPart],
    settings: EmulatorSettings,
    opened: Callable[[Mapping[str, Mapping[str, object]], str], None],
) -> None:
    ended = ending(settings.lifeline)
    found: dict[str, Mapping[str, object]] = {}
    for name, part in parts.items():
        try:
            found[name] = await part.open(settings)
        except OSError as error:
            raise DeviceError(
                f"the wire{f' of the {name}' if name else ''} cannot be opened "
                f"({error.strerror or error})",
                where=f"{settings.host}:{settings.port}",
                fix="choose another port, or 0 for a free one",
            ) from error
    channel = Channel(instrument)
    opened(found, await channel.open())
    await ended.wait()
    if settings.lifeline is not None:
        await channel.left()
        await until_motor_stands(lambda: instrument.moving, _ORPHAN_S)
    channel.close()
    for part in parts.values():
        part.close()
