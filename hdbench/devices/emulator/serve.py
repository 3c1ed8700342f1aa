"""Run an emulated node: in a process of its own for one session, or as a command."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from hdbench.devices.emulator.channel import open_channel
from hdbench.devices.emulator.core import NodeCore
from hdbench.devices.emulator.lifetime import ending, open_record, until_motor_stands
from hdbench.devices.emulator.machine import NodeMachine, Pace, PlantBench
from hdbench.devices.emulator.parameters import RefusedError
from hdbench.devices.emulator.ratings import identity_values, limit_values
from hdbench.devices.emulator.server import Device, ModbusRefusedError, ModbusServer, Space, Wire
from hdbench.devices.node.registers import Refusal
from hdbench.devices.node.states import State
from hdbench.errors import DeviceError, UsageError
from hdbench.profile.schema import ProfileData

__all__ = ["EmulatorSettings", "NodeDevice", "build_core", "emulate_bench", "serve"]

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
    wire : str
        What a device of registers speaks; see `hdbench.devices.emulator.server.Wire`.
    """

    host: str = "127.0.0.1"
    port: int = 0
    pace: Pace = "realtime"
    record: Path | None = None
    lifeline: int | None = None
    wire: Wire = "tcp"


class NodeDevice(Device):
    """A node's registers behind a server.

    Parameters
    ----------
    core : NodeCore
        The node.
    """

    functions = frozenset((3, 6, 16, 23))

    def __init__(self, core: NodeCore) -> None:
        self.core = core

    def tick(self) -> None:
        """Let the wall clock act."""
        self.core.tick()

    def left(self, connection: int) -> None:
        """End the session of a host that is gone."""
        self.core.disconnected(connection)

    def rest(self) -> None:
        """Produce samples."""
        self.core.machine.produce_ahead()

    def hears(self, function: int) -> bool:
        """Bring the node up to now."""
        self.core.machine.tick()
        return True

    def read(self, space: Space, address: int, count: int, connection: int) -> bytes:
        """Return registers."""
        return self.core.read(address, count, connection)

    def write(self, space: Space, address: int, raw: bytes, connection: int) -> None:
        """Write registers."""
        self.core.write(address, raw, connection)

    def note_refusal(self, refused: ModbusRefusedError, connection: int, transaction: int) -> None:
        """Keep the reason; a request that is none as Modbus has it concerns no register."""
        if not isinstance(refused, RefusedError):
            reason = Refusal.VALUE if refused.exception == 3 else Refusal.NONE
            refused = RefusedError(refused.exception, reason, 0)
        self.core.note_refusal(refused, connection)


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
    channel, control = await open_channel(
        core.machine.bench, busy=lambda: core.machine.state == State.RUNNING
    )
    ready({"address": address, "control": control})
    await ended.wait()
    if settings.lifeline is not None:
        await until_motor_stands(lambda: core.machine.busy, _ORPHAN_S)
    channel.close()
    server.close()


async def _open(core: NodeCore, settings: EmulatorSettings) -> tuple[ModbusServer, str]:
    """Open the wire and return its server and the address that a host opens."""
    if settings.wire not in ("tcp", "rtu"):
        raise UsageError(
            f"a node speaks no {settings.wire}",
            where="--wire",
            fix="choose tcp or rtu, or a profile with a polled Modbus device",
        )
    server = ModbusServer(NodeDevice(core), settings.wire)
    try:
        address = await server.open(settings.host, settings.port)
    except OSError as error:
        raise DeviceError(
            f"cannot listen ({error.strerror})",
            where="serial line" if settings.wire == "rtu" else f"{settings.host}:{settings.port}",
            fix="choose another port, or 0 for a free one",
        ) from error
    return server, address + (_QUERY if settings.wire == "rtu" else "")
