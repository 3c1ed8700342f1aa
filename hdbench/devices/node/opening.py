"""Open the node that a profile names."""

from __future__ import annotations

from functools import partial

from hdbench.devices.node.abilities import exchange_rate_hz
from hdbench.devices.node.driver import NodeDaq
from hdbench.devices.node.registers import block_scans
from hdbench.devices.node.spans import node_probe
from hdbench.devices.node.wire import NodeWire
from hdbench.devices.wire import Address, connect, parse_address
from hdbench.devices.wire.address import SerialSettings, serial_settings
from hdbench.errors import UsageError
from hdbench.profile.acquiring import Acquisition, NodeAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["node_address", "node_rate_hz", "open_node"]


def open_node(profile: ProfileData, table: Acquisition) -> NodeDaq:
    """Return the driver of the node in `table`; an `hdbench.devices.registry.OpenDaq`.

    Parameters
    ----------
    profile : ProfileData
        The bench, for the tacho's scale.
    table : NodeAcquisition
        How the node is reached.

    Returns
    -------
    NodeDaq
        Not connected yet.

    Raises
    ------
    UsageError
        If address or certificates cannot be used.
    """
    node = _node_table(table)
    address = node_address(node)
    link = connect(address, unit=node.unit, probe=node_probe, tls=node.tls)
    return NodeDaq(
        NodeWire(link, deadline_s=node.deadline_s),
        exchanges_hz=partial(exchange_rate_hz, address),
        tacho_rad_s_per_v=profile.tacho.gain_rad_s_per_v,
    )


def node_address(table: NodeAcquisition) -> Address:
    """Return the parsed address of a table with its serial settings.

    Parameters
    ----------
    table : NodeAcquisition
        ``[daq]``.

    Returns
    -------
    Address

    Raises
    ------
    UsageError
        If it is none, or a wire that nodes do not speak.
    """
    serial = serial_settings(table.serial) if table.serial else SerialSettings()
    address = parse_address(table.address, serial)
    if address.scheme not in ("tcp", "tls", "rtu"):
        raise UsageError(
            f"{table.address[:80]!r}: a node is reached by tcp://HOST:PORT, tls:// or rtu://",
            where="address",
            fix="for example tcp://192.168.0.7:502",
        )
    return address


def node_rate_hz(table: Acquisition) -> float:
    """Return the highest scan rate that the wire of `table` sustains, Hz; inf where embedded.

    Parameters
    ----------
    table : NodeAcquisition
        Address and channels.

    Returns
    -------
    float
    """
    node = _node_table(table)
    if node.address == "embedded":
        return float("inf")
    n_channels = len(node.channels)
    return exchange_rate_hz(node_address(node), n_channels) * block_scans(n_channels)


def _node_table(table: Acquisition) -> NodeAcquisition:
    if not isinstance(table, NodeAcquisition):
        raise UsageError(
            f"driver {table.driver!r} is no node", where="key daq.driver", fix='driver = "node"'
        )
    return table
