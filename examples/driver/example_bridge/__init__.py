"""Driver of a strain-gauge amplifier; the record is all that hdbench looks for."""

from hdbench.devices.driver import Driver

from .bridge import MAX_RATE_HZ, BridgeDaq, probe
from .emulator import EmulatedBridge

DRIVER = Driver(
    open=lambda profile, table: BridgeDaq(table),
    rate_hz=lambda table: MAX_RATE_HZ,
    drives=lambda table: False,
    emulate=EmulatedBridge,
    emulated_speed=10.0,
    probe=probe,
)
