"""Driver of DATAQ instruments, as the registry knows it."""

from __future__ import annotations

from hdbench.devices.driver import Driver, later

DRIVER = Driver(
    open=later("hdbench.drivers.dataq.driver:open_dataq"),
    verify=later("hdbench.drivers.dataq.driver:verify"),
    rate_hz=later("hdbench.drivers.dataq.driver:dataq_rate_hz"),
    # no DATAQ instrument has an analog output
    drives=lambda _: False,
    emulate=later("hdbench.drivers.dataq.emulator:emulate_dataq"),
    emulated_speed=10.0,
    probe=later("hdbench.drivers.dataq.driver:probe"),
)
