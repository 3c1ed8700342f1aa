"""Run an emulated node: in a process of its own for one session, or as a command."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from hdbench.devices.emulator.channel import Channel
from hdbench.devices.emulator.core import NodeCore
from hdbench.devices.emulator.lifetime import ending, open_record, until_motor_stands
from hdbench.devices.emulator.machine import NodeMachine, Pace, PlantBench
from hdbench.devices.emulator.ratings import identity_values, limit_values
from hdbench.devices.emulator.rtuserver import RtuNodeServer
from hdbench.devices.emulator.server import NodeServer
from hdbench.devices.node.states import State
from hdbench.errors import DeviceError
from hdbench.profile.schema import ProfileData

__all__ = ["EmulatorSettings", "build_core", "emulate_bench", "serve"]

# time in which an orphaned node must have stopped its motor: watchdog (2 s at most) and braking
_ORPHAN_S = 3.0
# a pseudo-terminal passes characters at once; hosts reckon with the fastest usual rate
_QUERY = "?baud=921600"


@dataclass(frozen=True, slots=True)
class EmulatorSettings:
    """How an emulated node is served.

    Parameters
    ----------
    host : str
        Address to listen on; Modbus has no authentication, so keep it on the loopback.
    port : int
        TCP port; 0 takes a free one.
    pace : {"realtime", "fast"}
        Samples by the wall clock, or as fast as the host reads them.
    record : Path or None
        File for one JSON line per change of state.
    lifeline : int or None
        File descriptor whose end of file ends the node, once its motor stands.
    rtu : bool
        Whether to serve Modbus RTU on a pseudo-terminal instead of a TCP port.
    """

    host: str = "127.0.0.1"
    port: int = 0
    pace: Pace = "realtime"
    record: Path | None = None
    lifeline: int | None = None
    rtu: bool = False


def build_core(
    bench: PlantBench,
    profile: ProfileData,
    seed: int,
    *,
    pace: Pace,
    record: Callable[[Mapping[str, object]], None] = lambda _: None,
    clock: Callable[[], float] = time.monotonic,
) -> NodeCore:
    """Return a node around `bench` with the limits of `profile`.

    Parameters
    ----------
    bench : PlantBench
        The simulated bench.
    profile : ProfileData
        The profile it was built from.
    seed : int
        Seed, shown as the serial number.
    pace : {"realtime", "fast"}
        Samples by the wall clock, or as fast as the host reads them.
    record : callable, optional
        Takes one mapping per change of state and while the motor turns.
    clock : callable, optional
        Monotonic clock, s.

    Returns
    -------
    NodeCore
    """
    machine = NodeMachine(bench, pace=pace, clock=clock, record=record)
    return NodeCore(
        machine,
        identity=identity_values(seed),
        limits=limit_values(profile),
        clock=clock,
    )


def emulate_bench(
    profile: ProfileData,
    plant: str,
    seed: int,
    settings: EmulatorSettings,
    *,
    ready: Callable[[Mapping[str, object]], None],
    model_file: Path | None = None,
) -> None:
    """Build the simulated bench of `profile` and serve it as `serve` does.

    Parameters
    ----------
    profile : ProfileData
        The bench.
    plant : str
        Name or path of the plant.
    seed : int
        Seed of everything simulated, at least 0.
    settings : EmulatorSettings
        Where and how.
    ready : callable
        Called once with ``address``, the one that a host opens, and ``control``, that of the
        simulated operator's channel.
    model_file : Path, optional
        Extended model to emulate in place of the profile's.

    Raises
    ------
    ProfileError, DataError
        If plant or model file are invalid.
    DeviceError, StorageError
        As for `serve`.
    """
    from hdbench.devices.emulator.bench import SimulatedBench
    from hdbench.devices.emulator.plantfile import load_plant
    from hdbench.model.modelfile import load_model

    model = load_model(model_file) if model_file else None
    bench = SimulatedBench(profile, load_plant(plant), seed, model=model)
    serve(bench, profile, seed, settings, ready)


def serve(
    bench: PlantBench,
    profile: ProfileData,
    seed: int,
    settings: EmulatorSettings,
    ready: Callable[[Mapping[str, object]], None],
) -> None:
    """Serve `bench` until SIGTERM, Ctrl-C or the end of the lifeline.

    Parameters
    ----------
    bench : PlantBench
        The simulated bench.
    profile : ProfileData
        The profile it was built from.
    seed : int
        Seed, part of the serial number.
    settings : EmulatorSettings
        Where and how.
    ready : callable
        Called once with ``address``, the one that a host opens, and ``control``, that of the
        simulated operator's channel.

    Raises
    ------
    DeviceError
        If the port cannot be used.
    StorageError
        If the record file cannot be written.
    """
    with ExitStack() as stack:
        record = open_record(settings.record, stack)
        core = build_core(bench, profile, seed, pace=settings.pace, record=record)
        asyncio.run(_serve(core, settings, ready))


async def _serve(
    core: NodeCore, settings: EmulatorSettings, ready: Callable[[Mapping[str, object]], None]
) -> None:
    ended = ending(settings.lifeline)
    server, address = await _open(core, settings)
    channel = Channel(core.machine.bench, busy=lambda: core.machine.state == State.RUNNING)
    ready({"address": address, "control": await channel.open()})
    await ended.wait()
    if settings.lifeline is not None:
        await channel.left()
        await until_motor_stands(lambda: core.machine.busy, _ORPHAN_S)
    channel.close()
    server.close()


async def _open(
    core: NodeCore, settings: EmulatorSettings
) -> tuple[NodeServer | RtuNodeServer, str]:
    """Open the wire and return its server and the address that a host opens."""
    try:
        if settings.rtu:
            line = RtuNodeServer(core)
            return line, f"rtu://{await line.open()}{_QUERY}"
        server = NodeServer(core)
        host, port = await server.open(settings.host, settings.port)
    except OSError as error:
        raise DeviceError(
            f"cannot listen ({error.strerror})",
            where="serial line" if settings.rtu else f"{settings.host}:{settings.port}",
            fix="choose another port, or 0 for a free one",
        ) from error
    return server, f"tcp://{host}:{port}"
