"""Benches on the wire: ports, the node driver, and the emulated bench."""

from __future__ import annotations

from hdbench.devices.node.operator import SimulatedOperator
from hdbench.devices.opening import open_bench, stop_bench
from hdbench.devices.ports import (
    AcquisitionSettings,
    Bench,
    Block,
    Identity,
    Operator,
    SafeState,
)

__all__ = [
    "AcquisitionSettings",
    "Bench",
    "Block",
    "Identity",
    "Operator",
    "SafeState",
    "SimulatedOperator",
    "open_bench",
    "stop_bench",
]
