"""What stops the motor, and the proof that it stands."""

from __future__ import annotations

import struct
import subprocess
import time
from typing import Any

from .wires import RtuWire, TcpWire, WireError, open_wire

# between two looks at the motor, s
POLL_S = 0.01
# rounds of reading back in a row that must find everything safe
CALM = 2
# one connection is tried for so long before it is opened anew, and of that the drive may brake for
# so long before it is disabled, s
SESSION_S = 2.5
BRAKING_S = 1.0
# how often the device is asked who it is before the motion; on a serial line a frame may be lost
ASKS = 3


def wrong(reply: bytes, check: dict[str, Any]) -> str:
    """Return what a reply says against the safe state; empty when nothing."""
    form, at = check["as"], int(check["at"])
    size = struct.calcsize(form)
    if len(reply) < at + size:
        return f"{check['name']}: a reply of {len(reply)} bytes"
    raw = reply[at : at + size]
    if check["order"]:
        raw = bytes(raw[index] for index in check["order"])
    (value,) = struct.unpack(form, raw)
    if check["mask"]:
        value &= check["mask"]
    # written so that NaN fails
    if check["low"] <= value <= check["high"]:
        return ""
    return f"{check['name']} {value:.6g}"


def note_identity(target: dict[str, Any]) -> None:
    """Note who answers, so that nobody else is ever written to; the session waits meanwhile."""
    if not target["identity"]:
        return
    for ask in range(1, ASKS + 1):
        try:
            wire = open_wire(target, alone=False)
            try:
                target["known"] = _identity(target, wire)
            finally:
                wire.close()
        except (WireError, OSError):
            if ask == ASKS:
                raise
        else:
            break
    # the device may want a rest before the session's next request
    time.sleep(target["rest_s"])


def make_safe(target: dict[str, Any], *, alone: bool) -> str:
    """Send what stops the motor until reading back proves it; return why it does not.

    Parameters
    ----------
    target : dict
        Device, requests and checks.
    alone : bool
        Whether the session is gone; where it is frozen, its serial port is taken over.
    """
    try:
        wire = open_wire(target, alone=alone)
    except WireError as error:
        return str(error)
    except OSError as error:
        return f"no connection ({error.strerror or error})"
    try:
        if target.get("known") and _identity(target, wire) != target["known"]:
            return "another device answers at this address; nothing was written to it"
        return _rounds(wire, target)
    except (WireError, OSError) as error:
        return str(getattr(error, "strerror", None) or error)
    finally:
        wire.close()


def stop_motor(order: dict[str, Any], *, alone: bool) -> str:
    """Make every target safe; return why one is not."""
    if order["command"]:
        return _run_whole(order)
    problems = [make_safe(target, alone=alone) for target in order["targets"]]
    return "; ".join(filter(None, problems))


def _identity(target: dict[str, Any], wire: TcpWire | RtuWire) -> str:
    """Return who answers, as hexadecimal digits."""
    return wire.transact(bytes.fromhex(target["identity"])).hex()


def _rounds(wire: TcpWire | RtuWire, target: dict[str, Any]) -> str:
    """Stop, look, and disable the drive once the motor stands or has had its time to brake."""
    start_s = time.monotonic()
    problem, calm = "", 0
    while calm < CALM and time.monotonic() - start_s < SESSION_S:
        if calm == 0:
            for act in target["acts"]:
                wire.transact(bytes.fromhex(act))
        problem = _look(wire, target["looks"])
        braking_s = time.monotonic() - start_s
        if (not problem and braking_s >= target["brake_s"]) or braking_s > BRAKING_S:
            for act in target["finals"]:
                wire.transact(bytes.fromhex(act))
            problem = problem or _look(wire, target["final_looks"])
        else:
            problem = problem or "the drive is to brake first"
        calm = 0 if problem else calm + 1
        time.sleep(POLL_S)
    return problem if calm < CALM else ""


def _look(wire: TcpWire | RtuWire, looks: list[dict[str, Any]]) -> str:
    for look in looks:
        pdu = bytes.fromhex(look["pdu"])
        reply = wire.transact(pdu)
        if reply[:1] != pdu[:1]:
            return f"{look['checks'][0]['name']}: the device refuses to tell"
        for check in look["checks"]:
            problem = wrong(reply, check)
            if problem:
                return problem
    return ""


def _run_whole(order: dict[str, Any]) -> str:
    """Stop the motor through the driver itself, where no bytes of it are known."""
    try:
        done = subprocess.run(
            order["command"],
            input=order["stdin"],
            capture_output=True,
            text=True,
            timeout=20.0,
            check=False,
        )
    except (OSError, subprocess.SubprocessError) as error:
        return str(error)
    return "" if done.returncode == 0 else (done.stdout.strip() or "no answer from the device")
