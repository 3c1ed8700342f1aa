"""The driver of bench controller nodes."""

from __future__ import annotations

from hdbench.devices.driver import Driver, later

__all__ = ["DRIVER"]

DRIVER = Driver(
    open=later("hdbench.devices.node.opening:open_node"),
    rate_hz=later("hdbench.devices.node.opening:node_rate_hz"),
    stop_target=later("hdbench.devices.node.stopping:stop_target"),
    emulate=later("hdbench.devices.emulator.serve:emulate_node"),
    probe=later("hdbench.devices.node.opening:probe"),
)
