"""Stop of a motor by the orders of a driver, and the proof that it stands."""

from __future__ import annotations

import contextlib
import struct
import subprocess
import time
from types import SimpleNamespace
from typing import Any

from hdbench.devices.wire.address import Address, SerialSettings
from hdbench.devices.wire.link import ExceptionReply, FrameError, Link, ReplyForm, connect
from hdbench.errors import HdbenchError
from hdbench.system.lines import can_share_ports

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
# one try of a transaction, s; on a serial line the silence before it and the characters of the
# longest request and reply beside it
REPLY_S, QUIET_S = 0.25, 0.1
_LONGEST = 256

# a request in the order: function code and data, and the form of its reply
Told = tuple[str, dict[str, Any]]
# why the device could not be reached
FAULTS = (FrameError, ExceptionReply, HdbenchError, OSError)


class Wire:
    """A connection of the guard's own, as strict about replies as the session's.

    Parameters
    ----------
    place : dict
        Where and how, as `hdbench.devices.guard.order.target_at` gives it.
    alone : bool
        Whether the session is gone, so that whoever has a serial port now is another program: it is
        left in peace then, and so is this connection by others. A frozen session's port is shared.
    """

    def __init__(self, place: dict[str, Any], *, alone: bool) -> None:
        line = SerialSettings(**place["serial"])
        address = Address(place["scheme"], place["host"], place["port"], place["path"], line)
        self._rest_s = float(place["rest_s"])
        self._reply_s = REPLY_S
        if address.is_line:
            self._reply_s += QUIET_S + line.exchange_s(_LONGEST, _LONGEST)
        tls: Any = SimpleNamespace(**place["tls"]) if place["tls"] else None
        self._link: Link = connect(
            address, unit=int(place["unit"]), tls=tls, claim="hold" if alone else "share"
        )
        self.close = self._link.close

    def transact(self, request: Told) -> bytes:
        """Send one request and return the PDU of its reply, which has its form."""
        time.sleep(self._rest_s)
        pdu, form = request
        check = ReplyForm(bytes.fromhex(form["head"]), form["size"], form["spare_bits"])
        return self._link.transact(bytes.fromhex(pdu), check, time.monotonic() + self._reply_s)

    def order(self, requests: list[Told]) -> None:
        """Send what stops the motor; whether it did is read back, a refusal is not the end."""
        for request in requests:
            with contextlib.suppress(ExceptionReply):
                self.transact(request)


def wrong(reply: bytes, check: dict[str, Any]) -> str:
    """Return what a reply says against the safe state; empty when nothing."""
    form, at = check["form"], int(check["at"])
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
    place = target["place"]
    if not target["identity"] or (place["scheme"] == "rtu" and not can_share_ports()):
        # the session has the port for itself; the guard gets it at the session's end
        return
    for ask in range(1, ASKS + 1):
        try:
            with contextlib.closing(Wire(place, alone=False)) as wire:
                stranger = _stranger(wire, target["identity"])
            break
        except FAULTS:
            if ask == ASKS:
                raise
    if stranger:
        raise FrameError(stranger)
    # the device may want a rest before the session's next request
    time.sleep(place["rest_s"])


def make_safe(target: dict[str, Any], *, alone: bool) -> str:
    """Send what stops the motor until reading back proves it; return why it does not."""
    try:
        with contextlib.closing(Wire(target["place"], alone=alone)) as wire:
            stranger = _stranger(wire, target["identity"])
            return f"{stranger}; nothing was written to it" if stranger else _rounds(wire, target)
    except FAULTS as error:
        return reason(error)


def _stranger(wire: Wire, looks: list[dict[str, Any]]) -> str:
    """Return that it is another device; what a look without checks shows first is the device's."""
    for look in looks:
        reply = wire.transact(look["request"])
        problem = next(filter(None, (wrong(reply, check) for check in look["checks"])), "")
        if problem or (not look["checks"] and look.setdefault("known", reply.hex()) != reply.hex()):
            told = f" ({problem})" if problem else ""
            return f"another device answers at this address{told}"
    return ""


def reason(error: Exception) -> str:
    """Return why the device could not be reached, without the place that the caller knows."""
    return str(getattr(error, "what", None) or getattr(error, "strerror", None) or error)


def stop_motor(order: dict[str, Any], *, alone: bool) -> str:
    """Make every target safe; return why one is not."""
    if order["command"]:
        return _run_whole(order)
    problems = [make_safe(target, alone=alone) for target in order["targets"]]
    return "; ".join(filter(None, problems))


def _rounds(wire: Wire, target: dict[str, Any]) -> str:
    """Stop, look, and disable the drive once the motor stands or has had its time to brake."""
    start_s = time.monotonic()
    problem, calm = "", 0
    while calm < CALM and time.monotonic() - start_s < SESSION_S:
        if calm == 0:
            wire.order(target["acts"])
        problem = _look(wire, target["looks"])
        braking_s = time.monotonic() - start_s
        if (not problem and braking_s >= target["brake_s"]) or braking_s > BRAKING_S:
            wire.order(target["finals"])
            problem = problem or _look(wire, target["final_looks"])
        else:
            problem = problem or "the drive is to brake first"
        calm = 0 if problem else calm + 1
        time.sleep(POLL_S)
    return problem if calm < CALM else ""


def _look(wire: Wire, looks: list[dict[str, Any]]) -> str:
    for look in looks:
        try:
            reply = wire.transact(look["request"])
        except ExceptionReply:
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
