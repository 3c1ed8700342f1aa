"""What hdbench has to know of a kind of device: one record for every driver."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from hdbench.devices.daq import Daq
from hdbench.profile.schema import ProfileData

if TYPE_CHECKING:
    from hdbench.devices.emulator.serving import EmulatedDevice, Emulation
    from hdbench.devices.guard.order import Target

__all__ = ["Driver", "later"]


@dataclass(frozen=True, kw_only=True)
class Driver:
    """One driver; only `open` is needed. ``table`` is its own table of the profile.

    Parameters
    ----------
    open : callable
        ``(profile, table) -> Daq``. Nothing is written yet. Raises `HdbenchError`, nothing else.
    verify : callable, optional
        ``(table) -> None``. Raises `ProfileError` where the table asks for what the device does not
        have; called before anything is opened.
    rate_hz : callable, optional
        ``(table) -> float``. Highest sustained scan rate of the table's channels, Hz, the wire
        included; inf where only the open device can tell.
    drives : callable, optional
        ``(table) -> bool``. Whether the device as described can put out the motor reference.
    stop_target : callable, optional
        ``(profile, table) -> Target or None``. Modbus requests by which the guard stops the motor;
        without them it stops the bench through the driver, which takes longer to start.
    emulate : callable, optional
        ``(emulation, table) -> EmulatedDevice``. A device of this kind around a simulated bench.
    emulated_speed : float, optional
        Device seconds per second that an emulation with a fast pace keeps.
    probe : callable, optional
        ``(port) -> str``. Asks who is on a serial port; empty where it is no such device.
    """

    open: Callable[[ProfileData, Any], Daq]
    verify: Callable[[Any], None] = lambda _: None
    rate_hz: Callable[[Any], float] = lambda _: math.inf
    drives: Callable[[Any], bool] = lambda _: True
    stop_target: Callable[[ProfileData, Any], Target | None] = lambda *_: None
    emulate: Callable[[Emulation, Any], EmulatedDevice] | None = None
    emulated_speed: float = 1.0
    probe: Callable[[str], str] | None = None


def later(place: str) -> Callable[..., Any]:
    """Return a function that is imported when it is first called."""

    def call(*given: Any) -> Any:
        module, _, name = place.partition(":")
        return getattr(import_module(module), name)(*given)

    return call
