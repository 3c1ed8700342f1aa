"""Bring the bench to a standstill through the device, and prove it by reading back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from hdbench.devices.ports import SafeState
from hdbench.errors import HdbenchError

__all__ = ["SafeActs", "reach_safe_state"]

# standing still: eight standard deviations of a tacho with 1 mV noise at 56 rad/s per volt
_STANDSTILL_RAD_S = 0.5
# the looped-back reference: offset and noise of the converter, far below what turns a motor
_ZERO_V = 0.02
# time for braking under the drive's control, for everything, and between two looks, s
_BRAKING_S = 1.0
_TIMEOUT_S = 2.5
_POLL_S = 0.02
# readings in a row that must find everything safe
_CALM = 2


@dataclass(frozen=True, slots=True)
class SafeActs:
    """What the safe state needs of the device; every act may raise `HdbenchError`.

    Parameters
    ----------
    zero : callable
        Writes reference 0.
    disable : callable
        Switches the enable line off and returns whether it reads back as off.
    stop : callable
        Stops the stream.
    look : callable
        Returns reference, V, and motor speed, rad/s, as measured; None for what is not.
    """

    zero: Callable[[], None]
    disable: Callable[[], bool]
    stop: Callable[[], None]
    look: Callable[[], tuple[float | None, float | None]]


def reach_safe_state(
    acts: SafeActs, clock: Callable[[], float], sleep: Callable[[float], None]
) -> SafeState:
    """Zero the reference, let the drive brake, disable it, and confirm; never raises.

    Parameters
    ----------
    acts : SafeActs
        The device.
    clock, sleep : callable
        Monotonic clock in s, and waiting.

    Returns
    -------
    SafeState
        ``velocity_rad_s`` is None where the device measures no speed.

    Notes
    -----
    The drive stays enabled for up to 1 s so that it brakes actively; if the reference cannot be
    zeroed, it is disabled at once.
    """
    start_s = clock()
    problem = _try(acts.zero)
    braking = not problem
    seen: tuple[float | None, float | None] = (None, None)
    calm = 0
    while calm < _CALM and clock() - start_s < _TIMEOUT_S:
        if calm or problem:
            sleep(_POLL_S)
        problem, seen = _round(acts)
        turning = not problem and seen[1] is not None and not _stands(seen[1])
        if turning and braking and clock() - start_s < _BRAKING_S:
            problem = f"the motor turns at {seen[1]:.4g} rad/s"
            calm = 0
            continue
        still_on = _disabled(acts)
        problem = problem or still_on or unsafe_because(*seen)
        calm = 0 if problem else calm + 1
    return SafeState(
        confirmed=calm == _CALM,
        reference_v=seen[0],
        velocity_rad_s=seen[1],
        detail=problem or "motor reference zero, drive disabled, motor standing",
    )


def unsafe_because(reference_v: float | None, velocity_rad_s: float | None) -> str:
    """Return why what was measured is not safe; empty when it is.

    Parameters
    ----------
    reference_v : float or None
        Motor reference as measured, V.
    velocity_rad_s : float or None
        Motor speed as measured, rad/s.

    Returns
    -------
    str
    """
    if reference_v is not None and not abs(reference_v) <= _ZERO_V:
        return f"the motor reference is {reference_v:.4g} V"
    if velocity_rad_s is not None and not _stands(velocity_rad_s):
        return f"the motor turns at {velocity_rad_s:.4g} rad/s"
    return ""


def _stands(velocity_rad_s: float) -> bool:
    return abs(velocity_rad_s) < _STANDSTILL_RAD_S


def _round(acts: SafeActs) -> tuple[str, tuple[float | None, float | None]]:
    """Zero, stop, look: again every time, since all of them may be repeated without harm."""
    seen: tuple[float | None, float | None] = (None, None)
    problem = _try(acts.zero) or _try(acts.stop)
    try:
        seen = acts.look()
    except HdbenchError as error:
        problem = problem or error.what
    return problem, seen


def _disabled(acts: SafeActs) -> str:
    try:
        return "" if acts.disable() else "the drive is still enabled"
    except HdbenchError as error:
        return error.what


def _try(act: Callable[[], None]) -> str:
    try:
        act()
    except HdbenchError as error:
        return error.what
    return ""
