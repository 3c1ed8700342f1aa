"""Safe state of a bench: reached through its device and confirmed by reading back."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hdbench.devices.bench import SafeState
from hdbench.errors import HdbenchError

if TYPE_CHECKING:
    from hdbench.devices.daq import Daq
    from hdbench.profile.schema import ProfileData

# standing still: eight standard deviations of a tacho with 1 mV noise at 56 rad/s per volt
STANDSTILL_RAD_S = 0.5
# time for everything, for braking under the drive's control where the motor is seen, and between
# two looks, s
_TIMEOUT_S = 2.5
_BRAKING_S = 1.0
_POLL_S = 0.02
# looks in a row that must find everything safe
_CALM = 2


@dataclass(frozen=True, slots=True)
class Seen:
    """What a device shows of its outputs and its motor.

    Parameters
    ----------
    reference_v : float or None
        Motor reference as measured or read back, V; None where the device has none.
    velocity_rad_s : float or None
        Motor speed as measured, rad/s; None where the device measures none.
    problem : str
        What else is not safe; empty when nothing.
    """

    reference_v: float | None = None
    velocity_rad_s: float | None = None
    problem: str = ""


def reach_safe_state(
    *,
    stop: Callable[[], object],
    look: Callable[[], Seen],
    disable: Callable[[], bool] = lambda: True,
    zero_v: float,
    brake_s: float = 0.0,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> SafeState:
    """Zero the reference, let the drive brake, disable it, and confirm; never raises.

    Parameters
    ----------
    stop : callable
        Brings the reference to zero and stops whatever runs. This and the next two may be repeated
        and raise `HdbenchError`.
    look : callable
        Returns what is `Seen`.
    disable : callable, optional
        Switches the drive off and returns whether it reads back as off.
    zero_v : float
        What still counts as reference zero, V.
    brake_s : float, optional
        Time from reference zero to drive off in any case, s.
    clock, sleep : callable, optional
        Monotonic clock in s, and waiting.

    Notes
    -----
    A motor that is seen turning gets up to 1 s to brake actively before the drive is disabled.
    Where the reference cannot be brought to zero, the drive is disabled at once.
    """
    start_s = clock()
    seen = Seen()

    def confirm(calm: int) -> str:
        nonlocal seen
        problem, seen = "", Seen()
        try:
            if calm == 0:
                stop()
            seen = look()
        except HdbenchError as error:
            problem = error.what
        problem = problem or _not_zero(seen, zero_v)
        turns = _turns(seen)
        braking_s = clock() - start_s
        if not problem and (braking_s < brake_s or (turns and braking_s < _BRAKING_S)):
            return turns or "the drive is to brake first"
        try:
            off = "" if disable() else "the drive is still enabled"
        except HdbenchError as error:
            off = error.what
        return problem or off or turns or seen.problem

    problem = until_calm(confirm, clock, sleep)
    done = "motor reference zero, drive disabled"
    return SafeState(
        confirmed=not problem,
        reference_v=seen.reference_v,
        velocity_rad_s=seen.velocity_rad_s,
        detail=problem or (done if seen.velocity_rad_s is None else f"{done}, motor standing"),
    )


def until_calm(
    look: Callable[[int], str], clock: Callable[[], float], sleep: Callable[[float], None]
) -> str:
    """Look until two looks in a row find nothing wrong, 2.5 s at most."""
    until_s = clock() + _TIMEOUT_S
    problem, calm = "no time was left to look", 0
    while calm < _CALM and clock() < until_s:
        problem = look(calm)
        calm = 0 if problem else calm + 1
        if calm < _CALM:
            sleep(_POLL_S)
    return "" if calm == _CALM else problem or "it was seen safe once only"


def _not_zero(seen: Seen, zero_v: float) -> str:
    # written so that NaN fails
    if seen.reference_v is None or abs(seen.reference_v) <= zero_v:
        return ""
    return f"the motor reference is {seen.reference_v:.4g} V"


def _turns(seen: Seen) -> str:
    if seen.velocity_rad_s is None or abs(seen.velocity_rad_s) < STANDSTILL_RAD_S:
        return ""
    return f"the motor turns at {seen.velocity_rad_s:.4g} rad/s"


def wait_for_standstill(
    daq: Daq,
    profile: ProfileData,
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> tuple[float | None, str]:
    """Wait until two readings in a row find the motor standing, by tacho or else by encoder."""
    speed: float | None = None
    last: tuple[float, float] | None = None
    blind = False

    def look(_: int) -> str:
        nonlocal speed, last, blind
        speed = None
        try:
            reading = daq.snapshot()
        except HdbenchError as error:
            return error.what
        # one who cannot see is not asked again
        blind = "tacho" not in reading and "encoder" not in reading
        if "tacho" in reading:
            speed = reading["tacho"] * profile.tacho.gain_rad_s_per_v
        elif "encoder" in reading:
            now, before = (clock(), reading["encoder"]), last
            last, speed = now, math.inf
            if before is not None and now[0] > before[0]:
                turn = 2.0 * math.pi / profile.encoder.counts_per_turn
                speed = (now[1] - before[1]) * turn / (now[0] - before[0])
        return _turns(Seen(velocity_rad_s=speed))

    why = until_calm(look, clock, sleep)
    if blind:
        return None, "the device measures no motor speed"
    return speed if speed is not None and math.isfinite(speed) else None, why
