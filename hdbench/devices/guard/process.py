"""The guard itself: a script of the standard library alone, run as a process of its own.

It is handed the bytes that stop the motor and the bytes that prove it, and waits. When the session
that started it ends without a word, or says nothing for too long while the motor may turn, it sends
them over a connection of its own until two rounds of reading back in a row find the motor standing.

First line on standard input, which is a socket: the order, as JSON. Then single letters: ``A``
watch closely, ``L`` watch with more patience, ``I`` watch for the end only, ``.`` a sign of life,
``Q`` the safe state was confirmed: leave. It answers every read with ``.``, and with a line
``R...`` ready, ``E...`` the device does not answer, ``F...`` it has stopped the motor,
``U...`` it could not confirm that.

This one file imports nothing of hdbench: it starts in a few hundredths of a second, takes some ten
megabytes, and nothing that breaks the session breaks it.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from typing import Any, NoReturn

# one try of a transaction, and between two looks at the motor, s
REPLY_S = 0.25
POLL_S = 0.01
# rounds of reading back in a row that must find everything safe
CALM = 2
# one connection is tried for so long before it is opened anew, and of that the drive may brake for
# so long before it is disabled, s
SESSION_S = 2.5
BRAKING_S = 1.0
# while the session brakes by itself, it may be silent for so long, s
PATIENT_S = 6.0
SAY_S = 10.0


class WireError(Exception):
    """What went wrong on the wire."""


class TcpWire:
    """Modbus TCP, or TLS, on a connection of the guard's own."""

    def __init__(self, target: dict[str, Any]) -> None:
        self._unit = int(target["unit"])
        self._number = 0
        raw = socket.create_connection((target["host"], target["port"]), REPLY_S)
        raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = _secured(raw, target["tls"]) if target["tls"] else raw

    def transact(self, pdu: bytes) -> bytes:
        """Send one request and return the PDU of its reply."""
        self._number = self._number % 0xFFFF + 1
        head = struct.pack(">HHHB", self._number, 0, len(pdu) + 1, self._unit)
        self._socket.sendall(head + pdu)
        until_s = time.monotonic() + REPLY_S
        while True:
            number, protocol, length, _ = struct.unpack(">HHHB", self._exactly(7, until_s))
            if protocol != 0 or not 2 <= length <= 254:
                raise WireError("no Modbus TCP")
            reply = self._exactly(length - 1, until_s)
            if number == self._number:
                return reply

    def _exactly(self, size: int, until_s: float) -> bytes:
        data = b""
        while len(data) < size:
            left_s = until_s - time.monotonic()
            if not left_s > 0.0:
                raise WireError("no reply in time")
            self._socket.settimeout(left_s)
            chunk = self._socket.recv(size - len(data))
            if not chunk:
                raise WireError("the device hung up")
            data += chunk
        return data

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


class RtuWire:
    """Modbus RTU on the serial line, which the session no longer uses."""

    def __init__(self, target: dict[str, Any]) -> None:
        self._unit = bytes((int(target["unit"]),))
        self._silence_s = float(target["silence_s"])
        self._handle = os.open(target["path"], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        _set_line(self._handle, target)

    def transact(self, pdu: bytes) -> bytes:
        """Send one request after a silence and return the PDU of its reply."""
        until_s = time.monotonic() + REPLY_S
        while self._readable(min(self._silence_s, until_s - time.monotonic())):
            self._take()
        frame = self._unit + pdu
        os.write(self._handle, frame + crc16(frame))
        data, until_s = b"", time.monotonic() + REPLY_S
        while self._readable(until_s - time.monotonic()):
            data += self._take()
            if len(data) >= 5 and data[:1] == self._unit and crc16(data[:-2]) == data[-2:]:
                return data[1:-2]
        raise WireError("no valid reply in time")

    def _readable(self, wait_s: float) -> bool:
        return wait_s > 0.0 and bool(select.select([self._handle], [], [], wait_s)[0])

    def _take(self) -> bytes:
        data = os.read(self._handle, 4096)
        if not data:
            raise WireError("the serial port was unplugged")
        return data

    def close(self) -> None:
        """Close the port."""
        os.close(self._handle)


def crc16(data: bytes) -> bytes:
    """Return the checksum of Modbus RTU, low byte first."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return struct.pack("<H", value)


def _secured(raw: socket.socket, files: dict[str, Any]) -> socket.socket:
    import ssl

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.load_verify_locations(files["authority"])
    context.load_cert_chain(files["certificate"], files["key"])
    return context.wrap_socket(raw, server_hostname=files["server_name"])


def _set_line(handle: int, target: dict[str, Any]) -> None:
    """Set bit rate, parity and stop bits; a closed USB port forgets them."""
    import termios

    speed = getattr(termios, f"B{target['baud_bd']}", None)
    flags = termios.CS8 | termios.CREAD | termios.CLOCAL
    if not os.path.realpath(target["path"]).startswith("/dev/pts/"):
        flags |= 0 if target["parity"] == "N" else termios.PARENB
        flags |= termios.PARODD if target["parity"] == "O" else 0
    flags |= termios.CSTOPB if target["stop_bits"] == 2 else 0
    settings = termios.tcgetattr(handle)
    rates = settings[4:6] if speed is None else [speed, speed]
    termios.tcsetattr(handle, termios.TCSANOW, [0, 0, flags, 0, *rates, settings[6]])


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


def _open(target: dict[str, Any]) -> TcpWire | RtuWire:
    return RtuWire(target) if target["wire"] == "rtu" else TcpWire(target)


def identity(target: dict[str, Any], wire: TcpWire | RtuWire | None = None) -> str:
    """Return who answers, as hexadecimal digits."""
    opened = wire or _open(target)
    try:
        return opened.transact(bytes.fromhex(target["identity"])).hex()
    finally:
        if wire is None:
            opened.close()


def make_safe(target: dict[str, Any]) -> str:
    """Send what stops the motor until reading back proves it; return why it does not."""
    try:
        wire = _open(target)
    except OSError as error:
        return f"no connection ({error.strerror or error})"
    try:
        if target.get("known") and identity(target, wire) != target["known"]:
            return "another device answers at this address; nothing was written to it"
        return _rounds(wire, target)
    except (WireError, OSError) as error:
        return str(getattr(error, "strerror", None) or error)
    finally:
        wire.close()


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


def run_whole(order: dict[str, Any]) -> str:
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


def stop_motor(order: dict[str, Any]) -> str:
    """Make every target safe; return why one is not."""
    if order["command"]:
        return run_whole(order)
    problems = [make_safe(target) for target in order["targets"]]
    return "; ".join(filter(None, problems))


class Guard:
    """Waits, and acts once.

    Parameters
    ----------
    link : socket
        To the session.
    order : dict
        What to do.
    """

    def __init__(self, link: socket.socket, order: dict[str, Any]) -> None:
        self._link = link
        self._order = order
        self._silence_s: float | None = None
        self._fired = False

    def prepare(self) -> None:
        """Find out who answers, so that only that device is ever written to."""
        try:
            for target in self._order["targets"]:
                if target["wire"] != "rtu" and target["identity"]:
                    target["known"] = identity(target)
        except (WireError, OSError) as error:
            self._tell(f"E{getattr(error, 'strerror', None) or error}\n")
            return
        self._tell("R\n")

    def watch(self) -> int:
        """Wait for the session's end, with or without a word."""
        while True:
            ready = select.select([self._link], [], [], self._silence_s)[0]
            if not ready:
                self.fire(f"no sign of life for {self._silence_s:g} s")
                self._silence_s = None
                continue
            try:
                words = self._link.recv(4096)
            except OSError:
                words = b""
            if b"Q" in words:
                return 0
            if not words:
                if not self._fired:
                    self.fire("the session has ended")
                return 0
            self._note(words)

    def _note(self, words: bytes) -> None:
        for letter in words.decode("ascii", "replace"):
            if letter in "ALI" and not self._fired:
                patience = {"A": float(self._order["silence_s"]), "L": PATIENT_S, "I": None}
                self._silence_s = patience[letter]
        self._tell(".")

    def fire(self, why: str) -> None:
        """Stop the motor; do not give up before the order's time is over."""
        self._fired = True
        start_s = time.monotonic()
        said_s = -SAY_S
        problem = stop_motor(self._order)
        while problem and time.monotonic() - start_s < self._order["try_s"]:
            if self._simulation_over():
                # nothing is left that could turn
                return
            if time.monotonic() - said_s >= SAY_S:
                said_s = time.monotonic()
                _say(f"STOP THE MOTOR BY HAND: the guard cannot confirm the safe state ({problem})")
                _let_go_of_pipes()
            time.sleep(5 * POLL_S)
            problem = stop_motor(self._order)
        took_s = time.monotonic() - start_s
        self._write_down(why, problem, took_s)
        if problem:
            _say(f"PRESS THE EMERGENCY STOP: the guard could not stop the motor ({problem})")
        else:
            _say(f"{why}; the guard has stopped the motor within {took_s:.2f} s, confirmed")
        self._tell(f"{'U' if problem else 'F'}{why}{': ' if problem else ''}{problem}\n")

    def _simulation_over(self) -> bool:
        """Return whether this guarded an emulator that has ended: nobody reads its lifeline."""
        asked = select.poll()
        for handle in self._order["keep"]:
            asked.register(handle, 0)
        return any(event & select.POLLERR for _, event in asked.poll(0))

    def _write_down(self, why: str, problem: str, took_s: float) -> None:
        event = {
            "event": "guard",
            "why": why,
            "confirmed": not problem,
            "problem": problem or None,
            "took_s": round(took_s, 4),
            "utc_s": round(time.time(), 3),
        }
        if self._order["log"]:
            # a full disk does not keep a motor from being stopped
            with contextlib.suppress(OSError):
                flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
                handle = os.open(self._order["log"], flags, 0o644)
                os.write(handle, json.dumps(event).encode() + b"\n")
                os.fsync(handle)
                os.close(handle)

    def _tell(self, words: str) -> None:
        with contextlib.suppress(OSError):
            self._link.send(words.encode(errors="replace"), socket.MSG_DONTWAIT)


def _say(text: str) -> None:
    with contextlib.suppress(OSError, ValueError):
        os.write(2, f"hdbench guard: {text}\n".encode(errors="replace"))


def _let_go_of_pipes() -> None:
    """Keep nobody waiting who reads what the session said; a person at a terminal is told on."""
    with contextlib.suppress(OSError):
        if not os.isatty(2):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 2)
            os.close(nowhere)


def main() -> NoReturn:
    """Take the order, watch, act if need be."""
    # what ends the session must not end the guard before it has done its work
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP", "SIGPIPE"):
        signal.signal(getattr(signal, name), signal.SIG_IGN)
    link = socket.socket(fileno=0)
    line = b""
    while not line.endswith(b"\n"):
        chunk = link.recv(1)
        if not chunk:
            sys.exit(0)
        line += chunk
    guard = Guard(link, json.loads(line))
    guard.prepare()
    sys.exit(guard.watch())


if __name__ == "__main__":
    main()
