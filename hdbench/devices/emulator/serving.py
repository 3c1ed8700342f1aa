"""Serve one emulated device that is an electrical instrument: in a session, or as a command."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

from hdbench.devices.emulator.bench import SimulatedBench
from hdbench.devices.emulator.instrument import DeviceClock, SimulatedInstrument
from hdbench.devices.emulator.kinds import EmulatedPart, MakePart
from hdbench.devices.emulator.lifetime import ending, open_record, until_motor_stands
from hdbench.devices.emulator.plantfile import load_plant
from hdbench.devices.emulator.serve import EmulatorSettings
from hdbench.errors import DeviceError, UsageError
from hdbench.profile.schema import ProfileData

__all__ = ["serve_part"]

# time in which a device that has lost its host must have stopped the motor: watchdog and braking
_ORPHAN_S = 7.0


def serve_part(
    make: MakePart,
    profile: ProfileData,
    plant: str,
    seed: int,
    settings: EmulatorSettings,
    *,
    ready: Callable[[Mapping[str, object]], None],
    speed: float,
    model_file: Path | None,
) -> None:
    """Serve a device with a simulated bench of its own until SIGTERM or its lifeline's end.

    Parameters
    ----------
    make : callable
        Builds the device.
    profile : ProfileData
        The bench; its ``[daq]`` is the device's table.
    plant : str
        Name or path of the plant.
    seed : int
        Seed of everything simulated, at least 0.
    settings : EmulatorSettings
        Where and how.
    ready : callable
        Called once with the keys of ``[daq]`` as the device has them, and with ``speed``.
    speed : float
        Device seconds per second.
    model_file : Path or None
        Refused: a host-written reference does not tell the whole motion beforehand.

    Raises
    ------
    UsageError
        If a model file is given.
    ProfileError
        If the plant is invalid.
    DeviceError, StorageError
        If the wire or the record file cannot be used.
    """
    if model_file is not None:
        raise UsageError(
            "an extended model needs the whole motion beforehand; this device's reference is "
            "written by its host as it goes",
            where="--model",
            fix="emulate the profile's own model, or a node",
        )
    with ExitStack() as stack:
        instrument = SimulatedInstrument(
            SimulatedBench(profile, load_plant(plant), seed),
            profile.encoder.counts_per_turn,
            clock=DeviceClock(speed, time.monotonic()),
            record=open_record(settings.record, stack),
        )
        part = make(instrument, profile, profile.daq, seed)
        asyncio.run(_serve(part, instrument, settings, lambda at: ready({**at, "speed": speed})))


async def _serve(
    part: EmulatedPart,
    instrument: SimulatedInstrument,
    settings: EmulatorSettings,
    ready: Callable[[Mapping[str, object]], None],
) -> None:
    ended = ending(settings.lifeline)
    try:
        found = await part.open(settings)
    except OSError as error:
        raise DeviceError(
            f"the wire cannot be opened ({error.strerror or error})",
            where=f"{settings.host}:{settings.port}",
            fix="choose another port, or 0 for a free one",
        ) from error
    ready(found)
    await ended.wait()
    if settings.lifeline is not None:
        await until_motor_stands(lambda: instrument.moving, _ORPHAN_S)
    part.close()
