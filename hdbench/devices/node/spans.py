"""Where groups of registers stand, and which of them may be written."""

from __future__ import annotations

from collections.abc import Sequence

from hdbench.devices.node.registers import IDENTITY, Register
from hdbench.devices.wire import ReplyCheck, read_registers

__all__ = ["node_probe", "span", "writable"]

# lengths that no other read of a node has, in registers
_PROBE_COUNTS = (3, 5, 7, 9, 11, 13, 17, 19)


def node_probe(number: int) -> tuple[bytes, ReplyCheck]:
    """Return the n-th who-are-you read of a node, a `hdbench.devices.wire.Probe`."""
    count = _PROBE_COUNTS[number % len(_PROBE_COUNTS)]
    return read_registers(IDENTITY[0].address, count)


def span(group: Sequence[Register]) -> tuple[int, int]:
    """Return address and number of adjacent registers."""
    return group[0].address, sum(entry.size for entry in group)


def writable(group: Sequence[Register], values: bytes) -> tuple[int, int]:
    """Return address and number of a write; only registers that the map calls writable pass."""
    closed = [entry.name for entry in group if entry.access != "rw"]
    address, count = span(group)
    if closed or len(values) != 2 * count:
        raise ValueError(f"{len(values)} bytes for {count} registers; not writable: {closed}")
    return address, count
