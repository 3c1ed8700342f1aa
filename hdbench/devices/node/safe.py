"""Reach the safe state and prove it by reading back."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from hdbench.devices.node.codec import Value
from hdbench.devices.node.registers import Flag, State
from hdbench.devices.ports import SafeState
from hdbench.errors import HdbenchError

__all__ = ["reach_safe_state", "unsafe_because"]

# standing still: eight standard deviations of a tacho with 1 mV noise at 56 rad/s per volt
_STANDSTILL_RAD_S = 0.5
# longest time for the motor to come to rest, and between two looks at it
_TIMEOUT_S = 2.5
_POLL_S = 0.02
# readings in a row that must find everything safe
_CALM = 2


def reach_safe_state(
    make_safe: Callable[[], None],
    status: Callable[[], Mapping[str, Value]],
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> SafeState:
    """Order the safe state until two readings in a row confirm it; never raises.

    Parameters
    ----------
    make_safe, status : callable
        Order the safe state, and read the status block; both may raise `HdbenchError`.
    clock, sleep : callable
        Monotonic clock in s, and waiting.

    Returns
    -------
    SafeState
        What was read last.
    """
    until_s = clock() + _TIMEOUT_S
    seen: Mapping[str, Value] = {}
    detail = "no answer from the node"
    calm = 0
    while calm < _CALM and clock() < until_s:
        try:
            if calm == 0:
                make_safe()
            seen = status()
        except HdbenchError as error:
            seen, detail = {}, error.what
        else:
            detail = unsafe_because(seen)
        calm = calm + 1 if not detail else 0
        if calm < _CALM:
            sleep(_POLL_S)
    return SafeState(
        confirmed=calm == _CALM,
        reference_v=float(seen["reference_v"]) if seen else None,
        velocity_rad_s=float(seen["velocity_rad_s"]) if seen else None,
        detail=detail or "motor reference zero, drive disabled, motor standing",
    )


def unsafe_because(status: Mapping[str, Value]) -> str:
    """Return why the bench is not safe; empty when it is.

    Parameters
    ----------
    status : mapping
        The status block, by register name.

    Returns
    -------
    str
        One line; empty when the bench is safe.
    """
    reference_v = float(status["reference_v"])
    velocity_rad_s = float(status["velocity_rad_s"])
    if status["state"] == State.RUNNING:
        return "the node still runs"
    if reference_v != 0.0:
        return f"the motor reference is {reference_v:.4g} V"
    if not abs(velocity_rad_s) < _STANDSTILL_RAD_S:
        return f"the motor turns at {velocity_rad_s:.4g} rad/s"
    if int(status["status_flags"]) & Flag.DRIVE_ENABLED:
        return "the drive is still enabled"
    return ""
