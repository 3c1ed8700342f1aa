"""Make the outputs safe and prove it by reading back."""

from __future__ import annotations

from collections.abc import Callable

from hdbench.devices.modbus.outputs import Outputs
from hdbench.devices.modbus.watchdog import Watchdog
from hdbench.devices.ports import SafeState
from hdbench.errors import HdbenchError

__all__ = ["reach_safe_state", "switch_off", "zero"]

# time for everything and between two looks, s; looks in a row that must find everything safe
_TIMEOUT_S = 2.0
_POLL_S = 0.02
_CALM = 2


def zero(outputs: Outputs, watchdog: Watchdog | None, zero_v: float) -> float:
    """Bring the reference to zero and return what is read back, V.

    Parameters
    ----------
    outputs : Outputs
        The device's outputs.
    watchdog : Watchdog or None
        Its watchdog: while it rests after a trip, many devices refuse writes. An output that reads
        zero then is left as it is; else the trip is cleared and zero written.
    zero_v : float
        What still counts as zero, V.

    Returns
    -------
    float
    """
    if watchdog is not None and watchdog.rests():
        found = outputs.read_back()
        if abs(found) <= zero_v:
            return found
        watchdog.clear()
    return outputs.write(0.0)


def switch_off(outputs: Outputs, watchdog: Watchdog | None) -> bool:
    """Switch the enable line off and return whether it still reads as on.

    Parameters
    ----------
    outputs : Outputs
        The device's outputs.
    watchdog : Watchdog or None
        Its watchdog: a line that it has switched off is left as it is.

    Returns
    -------
    bool
    """
    if watchdog is not None and watchdog.rests() and not outputs.enabled():
        return False
    return outputs.enable(on=False)


def reach_safe_state(
    outputs: Outputs,
    watchdog: Watchdog | None,
    zero_v: float,
    brake_s: float,
    *,
    known: Callable[[], object],
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> SafeState:
    """Bring reference to zero, brake, then enable off, all read back twice; never raises.

    Parameters
    ----------
    outputs : Outputs
        The device's outputs.
    watchdog : Watchdog or None
        Its watchdog.
    zero_v : float
        What still counts as zero, V: one step of the register.
    brake_s : float
        Time from reference zero to enable off, s; none where the reference cannot be zeroed.
    known : callable
        Raises while it is not known that this is the device meant: nothing is written until then.
    clock, sleep : callable
        Monotonic clock in s, and waiting.

    Returns
    -------
    SafeState
        Without a speed: whoever measures it confirms the standstill.
    """
    until_s = clock() + _TIMEOUT_S
    found: float | None = None
    detail, calm, braked = "no answer from the device", 0, False
    while calm < _CALM and clock() < until_s:
        try:
            known()
        except HdbenchError as error:
            found, detail, calm = None, error.what, 0
            sleep(_POLL_S)
            continue
        try:
            found = zero(outputs, watchdog, zero_v) if calm == 0 else outputs.read_back()
            detail = "" if abs(found) <= zero_v else f"the motor reference is {found:.4g} V"
            if not detail and not braked:
                sleep(brake_s)
                braked = True
        except HdbenchError as error:
            found, detail = None, error.what
        try:
            on = switch_off(outputs, watchdog) if calm == 0 else outputs.enabled()
            detail = detail or ("the drive is still enabled" if on else "")
        except HdbenchError as error:
            detail = detail or error.what
        calm = 0 if detail else calm + 1
        if calm < _CALM:
            sleep(_POLL_S)
    return SafeState(
        confirmed=calm == _CALM,
        reference_v=found,
        velocity_rad_s=None,
        detail=detail or "motor reference zero, drive disabled",
    )
