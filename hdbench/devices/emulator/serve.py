"""The emulated node as one device around a simulated bench."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

from hdbench.devices.emulator.core import NodeCore
from hdbench.devices.emulator.machine import NodeMachine, Pace, PlantBench
from hdbench.devices.emulator.parameters import RefusedError
from hdbench.devices.emulator.ratings import identity_values, limit_values
from hdbench.devices.emulator.server import Device, ModbusRefusedError, ModbusServer, Space
from hdbench.devices.emulator.serving import Emulation, EmulatorSettings
from hdbench.devices.node.registers import Refusal
from hdbench.devices.node.states import State
from hdbench.errors import UsageError
from hdbench.profile.acquiring import NodeAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["EmulatedNode", "NodeDevice", "build_core", "emulate_node"]

# a pseudo-terminal passes characters at once; hosts reckon with the fastest usual rate
_QUERY = "?baud=921600"


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
    """Return a node around `bench` with the limits of `profile`."""
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
        self._server: ModbusServer | None = None

    async def open(self, settings: EmulatorSettings) -> Mapping[str, object]:
        """Open the wire and return ``address``."""
        if settings.wire not in ("tcp", "rtu"):
            raise UsageError(
                f"a node speaks no {settings.wire}",
                where="--wire",
                fix="choose tcp or rtu, or a profile with a polled Modbus device",
            )
        self._server = ModbusServer(NodeDevice(self.core), settings.wire)
        address = await self._server.open(settings.host, settings.port)
        return {"address": address + (_QUERY if settings.wire == "rtu" else "")}

    def close(self) -> None:
        """Close the wire."""
        if self._server is not None:
            self._server.close()


def emulate_node(emulation: Emulation, table: NodeAcquisition) -> EmulatedNode:
    """Return a node that makes the motor reference of a simulated bench itself."""
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
