"""One simulated bench at the terminals of two devices, each on its own wire."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

from hdbench.devices.emulator.bench import SimulatedBench
from hdbench.devices.emulator.instrument import DeviceClock, SimulatedInstrument
from hdbench.devices.emulator.kinds import EmulatedPart, part_of
from hdbench.devices.emulator.lifetime import ending, open_record, until_motor_stands
from hdbench.devices.emulator.machine import Pace
from hdbench.devices.emulator.plantfile import load_plant
from hdbench.devices.emulator.serve import EmulatorSettings
from hdbench.errors import DeviceError, UsageError
from hdbench.profile.acquiring import CompositeAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["emulate_composite", "emulated_speed"]

# fast pace: device seconds per second that a host-written reference and two wires keep up with
_FAST_SPEED = 4.0
# time in which devices that have lost their host must have stopped the motor
_ORPHAN_S = 7.0


def emulate_composite(
    profile: ProfileData,
    plant: str,
    seed: int,
    settings: EmulatorSettings,
    *,
    ready: Callable[[Mapping[str, object]], None],
    model_file: Path | None = None,
) -> None:
    """Serve both parts until SIGTERM, Ctrl-C or the end of the lifeline.

    Parameters
    ----------
    profile : ProfileData
        The bench; its ``[daq]`` is a composite.
    plant : str
        Name or path of the plant.
    seed : int
        Seed of everything simulated, at least 0.
    settings : EmulatorSettings
        Where and how; the port is the first one's, the others are free ones.
    ready : callable
        Called once with ``inputs`` and ``outputs``, each with its keys, and ``speed``.
    model_file : Path, optional
        Refused: a host-written reference does not tell the whole motion beforehand.

    Raises
    ------
    UsageError
        If the profile has another driver, or a part has no emulator.
    ProfileError
        If the plant is invalid.
    DeviceError, StorageError
        If a wire or the record file cannot be used.
    """
    table = profile.daq
    if not isinstance(table, CompositeAcquisition) or model_file is not None:
        raise UsageError(
            "two emulated devices need a composite in the profile, and its own model",
            where="--profile, --model",
            fix='name a profile with driver = "composite", and leave out --model',
        )
    speed = emulated_speed(table, settings.pace)
    with ExitStack() as stack:
        instrument = SimulatedInstrument(
            SimulatedBench(profile, load_plant(plant), seed),
            profile.encoder.counts_per_turn,
            clock=DeviceClock(speed, time.monotonic()),
            record=open_record(settings.record, stack),
        )
        parts = {
            name: part_of(part.driver)(instrument, profile, part, seed)
            for name, part in (("inputs", table.inputs), ("outputs", table.outputs))
        }

        def opened(found: Mapping[str, object]) -> None:
            ready({"address": "parts", **found, "speed": speed})

        asyncio.run(_serve(instrument, parts, settings, opened))


def emulated_speed(table: CompositeAcquisition, pace: Pace) -> float:
    """Return how many device seconds pass in a second.

    Parameters
    ----------
    table : CompositeAcquisition
        Both devices.
    pace : {"realtime", "fast"}
        What was asked for.

    Returns
    -------
    float
        1 with polled inputs at any pace: they are read by this computer's clock.
    """
    return _FAST_SPEED if pace == "fast" and table.inputs.driver != "modbus" else 1.0


async def _serve(
    instrument: SimulatedInstrument,
    parts: Mapping[str, EmulatedPart],
    settings: EmulatorSettings,
    opened: Callable[[Mapping[str, object]], None],
) -> None:
    ended = ending(settings.lifeline)
    found: dict[str, object] = {}
    for name, part in parts.items():
        try:
            found[name] = await part.open(settings)
        except OSError as error:
            raise DeviceError(
                f"the wire of the {name} cannot be opened ({error.strerror or error})",
                where=settings.host,
                fix="choose another port, or 0 for a free one",
            ) from error
    opened(found)
    await ended.wait()
    if settings.lifeline is not None:
        await until_motor_stands(lambda: instrument.moving, _ORPHAN_S)
    for part in parts.values():
        part.close()
