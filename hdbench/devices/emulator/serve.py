"""The emulated node as one device around a simulated bench."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from hdbench.devices.emulator.core import NodeCore
from hdbench.devices.emulator.machine import NodeMachine, Pace, PlantBench
from hdbench.devices.emulator.ratings import identity_values, limit_values
from hdbench.devices.emulator.rtuserver import RtuNodeServer
from hdbench.devices.emulator.server import NodeServer
from hdbench.devices.emulator.serving import Emulation, EmulatorSettings
from hdbench.devices.node.states import State
from hdbench.profile.acquiring import NodeAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["EmulatedNode", "build_core", "emulate_node"]

# a pseudo-terminal passes characters at once; hosts reckon with the fastest usual rate
_QUERY = "?baud=921600"


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


class EmulatedNode:
    """Implements `hdbench.devices.emulator.serving.EmulatedDevice`.

    Parameters
    ----------
    core : NodeCore
        The node.
    """

    def __init__(self, core: NodeCore) -> None:
        self.core = core
        self._server: NodeServer | RtuNodeServer | None = None

    async def open(self, settings: EmulatorSettings) -> Mapping[str, object]:
        """Open the wire and return ``address``."""
        if settings.rtu:
            line = RtuNodeServer(self.core)
            self._server = line
            return {"address": f"rtu://{await line.open()}{_QUERY}"}
        server = NodeServer(self.core)
        self._server = server
        host, port = await server.open(settings.host, settings.port)
        return {"address": f"tcp://{host}:{port}"}

    def close(self) -> None:
        """Close the wire."""
        if self._server is not None:
            self._server.close()


def emulate_node(emulation: Emulation, table: NodeAcquisition) -> EmulatedNode:
    """Return a node that makes the motor reference of a simulated bench itself.

    Parameters
    ----------
    emulation : Emulation
        The bench.
    table : NodeAcquisition
        ``[daq]``.

    Returns
    -------
    EmulatedNode
    """
    core = build_core(
        emulation.bench,
        emulation.profile,
        emulation.seed,
        pace=emulation.pace,
        record=emulation.record,
    )
    emulation.moving = lambda: core.machine.busy
    emulation.busy = lambda: core.machine.state == State.RUNNING
    return EmulatedNode(core)
