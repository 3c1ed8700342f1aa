"""The guard's order for a node: command "safe", which anybody may give, and the status block."""

from __future__ import annotations

from hdbench.devices.guard.order import Check, Look, Target, target_at
from hdbench.devices.node.opening import node_address
from hdbench.devices.node.registers import IDENTITY, STATUS, Command, Flag, register
from hdbench.devices.safestate import STANDSTILL_RAD_S
from hdbench.devices.wire import read_registers, write_register
from hdbench.profile.acquiring import NodeAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["stop_target"]


def stop_target(_profile: ProfileData, table: NodeAcquisition) -> Target:
    """Return how a node stops the motor."""
    first = STATUS[0].address

    def at(name: str) -> int:
        return 2 + 2 * (register(name).address - first)

    count = sum(entry.size for entry in STATUS)
    active = Flag.RUNNING | Flag.DRIVE_ENABLED
    checks = (
        Check("motor reference, V", at("reference_v"), ">f", 0.0, 0.0),
        Check(
            "motor speed, rad/s", at("velocity_rad_s"), ">f", -STANDSTILL_RAD_S, STANDSTILL_RAD_S
        ),
        Check("running or enabled, flags", at("status_flags"), ">H", 0, 0, mask=int(active)),
    )
    return Target(
        target_at(node_address(table), table.unit, table.tls),
        acts=(write_register(register("command").address, Command.SAFE),),
        looks=(Look(read_registers(first, count), checks),),
        identity=read_registers(IDENTITY[0].address, sum(entry.size for entry in IDENTITY)),
    )
