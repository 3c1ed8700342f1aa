"""Opening of a node: its link, its rate, its stop target, its probe."""

from __future__ import annotations

from functools import partial

from hdbench.devices.driver import Driver, later
from hdbench.devices.guard.order import Check, Look, Target, target_at
from hdbench.devices.node.access import NodeAccess, NodeWire, node_probe, span
from hdbench.devices.node.driver import NodeDaq, exchange_rate_hz
from hdbench.devices.node.registers import (
    IDENTITY,
    STATUS,
    WORD_ORDER_TEST,
    Command,
    Flag,
    block_scans,
    register,
)
from hdbench.devices.registers import decode_group
from hdbench.devices.safestate import STANDSTILL_RAD_S
from hdbench.devices.wire import Address, connect, parse_address, read_registers, write_register
from hdbench.devices.wire.address import SerialSettings, serial_settings
from hdbench.errors import BusyError, HdbenchError, UsageError
from hdbench.profile.acquiring import NodeAcquisition
from hdbench.profile.schema import ProfileData

# rates at which a port is asked for a node, fastest first
_RATES_BD = (921600, 115200)
_PROBE_S = 0.3


def open_node(profile: ProfileData, table: NodeAcquisition) -> NodeDaq:
    """Return the driver of the node in `table`."""
    address = node_address(table)
    link = connect(address, unit=table.unit, probe=node_probe, tls=table.tls)
    return NodeDaq(
        NodeAccess(link, deadline_s=table.deadline_s),
        exchanges_hz=partial(exchange_rate_hz, address),
        tacho_rad_s_per_v=profile.tacho.gain_rad_s_per_v,
    )


def node_address(table: NodeAcquisition) -> Address:
    """Return the parsed address of a table with its serial settings."""
    serial = serial_settings(table.serial) if table.serial else SerialSettings()
    address = parse_address(table.address, serial)
    if address.scheme not in ("tcp", "tls", "rtu"):
        raise UsageError(
            f"{table.address[:80]!r}: a node is reached by tcp://HOST:PORT, tls:// or rtu://",
            where="address",
            fix="for example tcp://192.168.0.7:502",
        )
    return address


def node_rate_hz(table: NodeAcquisition) -> float:
    """Return the highest scan rate that the wire of `table` sustains, Hz; inf where embedded."""
    if table.address == "embedded":
        return float("inf")
    n_channels = len(table.channels)
    return exchange_rate_hz(node_address(table), n_channels) * block_scans(n_channels)


def probe(path: str) -> str:
    """Ask a port for the identity of a node, at the usual rates."""
    last: HdbenchError | None = None
    for rate_bd in _RATES_BD:
        link = connect(parse_address(f"rtu://{path}?baud={rate_bd}"), probe=node_probe)
        wire = NodeWire(link, deadline_s=_PROBE_S)
        try:
            values = decode_group(IDENTITY, wire.read(IDENTITY))
        except BusyError:
            raise
        except HdbenchError as error:
            last = error
            continue
        finally:
            wire.close()
        if values["word_order"] == WORD_ORDER_TEST:
            who = " ".join(str(values[key]) for key in ("vendor", "model", "serial"))
            return f"bench controller node: {who} (rtu://{path}?baud={rate_bd})"
    if last is not None:
        raise last
    return ""


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
        identity=(Look(read_registers(*span(IDENTITY))),),
    )


DRIVER = Driver(
    open=open_node,
    rate_hz=node_rate_hz,
    stop_target=stop_target,
    emulate=later("hdbench.devices.emulator.node:emulate_node"),
    probe=probe,
)
