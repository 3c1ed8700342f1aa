"""Driver of LabJack T4 and T7, as the registry knows it."""

from __future__ import annotations

from hdbench.devices.driver import Driver, later

DRIVER = Driver(
    open=later("hdbench.drivers.labjack.driver:open_labjack"),
    verify=later("hdbench.drivers.labjack.scanlist:check_table"),
    rate_hz=later("hdbench.drivers.labjack.driver:labjack_rate_hz"),
    drives=lambda table: table.output is not None,
    stop_target=later("hdbench.drivers.labjack.outputs:stop_target"),
    emulate=later("hdbench.drivers.labjack.emulator.device:emulate_labjack"),
    # the host writes the reference every millisecond of real time then, what two cores still keep
    emulated_speed=5.0,
)
