"""Outputs to their safe values, past a watchdog that rests."""

from __future__ import annotations

from hdbench.devices.modbus.outputs import Outputs
from hdbench.devices.modbus.watchdog import Watchdog

__all__ = ["switch_off", "zero"]


def zero(outputs: Outputs, watchdog: Watchdog | None, zero_v: float) -> float:
    """Bring the reference to zero and return what is read back, V."""
    if watchdog is not None and watchdog.rests():
        found = outputs.read_back()
        if abs(found) <= zero_v:
            return found
        watchdog.clear()
    return outputs.write(0.0)


def switch_off(outputs: Outputs, watchdog: Watchdog | None) -> bool:
    """Switch the enable line off and return whether it still reads as on."""
    if watchdog is not None and watchdog.rests() and not outputs.enabled():
        return False
    return outputs.enable(on=False)
