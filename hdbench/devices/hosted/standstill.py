"""Whether the motor stands, by what the device measures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from hdbench.devices.daq import Daq
from hdbench.devices.hosted.settings import HostSettings
from hdbench.devices.ports import SafeState
from hdbench.devices.safestate import STANDSTILL_RAD_S, until_calm
from hdbench.errors import HdbenchError

__all__ = ["confirm_safe", "wait_for_standstill"]


class _Speed:
    """Motor speed from tacho, else from two readings of the encoder."""

    def __init__(self, daq: Daq, settings: HostSettings, clock: Callable[[], float]) -> None:
        self._daq = daq
        self._settings = settings
        self._clock = clock
        self._last: tuple[float, float] | None = None

    def __call__(self) -> float | None:
        reading = self._daq.snapshot()
        if "tacho" in reading:
            return reading["tacho"] * self._settings.tacho_rad_s_per_v
        if "encoder" not in reading:
            return None
        now = (self._clock(), reading["encoder"])
        last, self._last = self._last, now
        if last is None or not now[0] > last[0]:
            return math.inf
        turn = 2.0 * math.pi / self._settings.counts_per_turn
        return (now[1] - last[1]) * turn / (now[0] - last[0])


def wait_for_standstill(
    daq: Daq,
    settings: HostSettings,
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> tuple[float | None, str]:
    """Wait until two readings in a row find the motor standing."""
    speed = _Speed(daq, settings, clock)
    found: float | None = None
    blind = False

    def look(_: int) -> str:
        nonlocal found, blind
        try:
            found = speed()
        except HdbenchError as error:
            found = None
            return error.what
        blind = found is None
        # one who cannot see is not asked again
        stands = found is None or abs(found) < STANDSTILL_RAD_S
        return "" if stands else f"the motor turns at {found:.4g} rad/s"

    why = until_calm(look, clock, sleep)
    if blind:
        return None, "the device measures no motor speed"
    known = found if found is not None and math.isfinite(found) else None
    return known, why


def confirm_safe(
    safe: SafeState,
    daq: Daq,
    settings: HostSettings,
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> SafeState:
    """Return `safe` with the motor's standstill, where the device has not looked itself."""
    if not safe.confirmed or safe.velocity_rad_s is not None:
        return safe
    speed, why = wait_for_standstill(daq, settings, clock, sleep)
    detail = why or f"{safe.detail}, motor standing"
    return replace(safe, confirmed=not why, velocity_rad_s=speed, detail=detail)
