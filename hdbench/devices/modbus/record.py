"""The driver of polled Modbus devices."""

from __future__ import annotations

from hdbench.devices.driver import Driver, later

__all__ = ["DRIVER"]

DRIVER = Driver(
    open=later("hdbench.devices.modbus.opening:open_modbus"),
    rate_hz=later("hdbench.devices.modbus.opening:modbus_rate_hz"),
    drives=lambda table: table.output is not None,
    stop_target=later("hdbench.devices.modbus.stopping:stop_target"),
    emulate=later("hdbench.devices.emulator.modbus.serve:emulate_modbus"),
)
