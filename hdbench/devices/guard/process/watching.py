"""Watcher: acts when the session ends without a word or says nothing for too long."""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import sys
import threading
import time
from typing import Any, NoReturn

from hdbench.devices.wire.address import dial, parse_address
from hdbench.system.files import sync_file
from hdbench.system.processes import ignore_signals

from .stopping import FAULTS, POLL_S, note_identity, reason, stop_motor

# what a line takes where somebody reads it, s
_SAY_S = 0.05
# the thread of the last line
_last: list[threading.Thread] = []
# while the session brakes by itself, it may be silent for so long, s
PATIENT_S = 6.0
SAY_S = 10.0
# to this computer itself, s
CONNECT_S = 5.0


def say(text: str) -> None:
    """Say it on stderr, if that is still there and takes it: what nobody reads is dropped."""
    if _last and _last[-1].is_alive():
        return
    line = f"hdbench guard: {text}\n".encode(errors="replace")

    def write() -> None:
        with contextlib.suppress(OSError):
            os.write(2, line)

    # a pipe that is full holds up this thread alone
    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    writer.join(_SAY_S)
    _last[:] = [writer]


def let_go_of_pipes() -> None:
    """Keep nobody waiting who reads what the session said; a person at a terminal is told on."""
    with contextlib.suppress(OSError):
        if not os.isatty(2):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 2)
            os.close(nowhere)


def write_down(log: str | None, why: str, problem: str, took_s: float) -> None:
    """Add one line to the log, where there is one."""
    event: dict[str, Any] = {
        "event": "guard",
        "why": why,
        "confirmed": not problem,
        "problem": problem or None,
        "took_s": round(took_s, 4),
        "utc_s": round(time.time(), 3),
    }
    if log:
        # a full disk does not keep a motor from being stopped
        with contextlib.suppress(OSError):
            handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            try:
                os.write(handle, json.dumps(event).encode() + b"\n")
                sync_file(handle)
            finally:
                os.close(handle)


class Watcher:
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
        self._words = b""
        self._alone = False
        self._emulator: socket.socket | None = None
        link.setblocking(False)

    def prepare(self) -> None:
        """Find out who answers, so that only that device is ever written to."""
        try:
            if self._order["emulator"]:
                place = parse_address(self._order["emulator"])
                self._emulator = dial((place.host, place.port), CONNECT_S)
                self._emulator.setblocking(False)
            for target in self._order["targets"]:
                note_identity(target)
        except FAULTS as error:
            self._tell(f"E{reason(error)}\n")
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
            self._listen()
            words, self._words = self._words, b""
            if b"Q" in words:
                return 0
            if words:
                self._note(words)
            if self._alone:
                if not self._fired:
                    self.fire("the session has ended")
                return 0

    def _listen(self) -> None:
        """Take what the session has said, and notice its end."""
        try:
            while words := self._link.recv(4096):
                self._words += words
        except BlockingIOError:
            return
        except OSError:
            pass
        self._alone = True

    def _note(self, words: bytes) -> None:
        for letter in words.decode("ascii", "replace"):
            if letter in "ALI" and not self._fired:
                patience = {"A": float(self._order["silence_s"]), "L": PATIENT_S, "I": None}
                self._silence_s = patience[letter]
        self._tell(".")

    def fire(self, why: str) -> None:
        """Stop the motor; do not give up before the order's time is over."""
        self._fired = True
        # first the reason: what is stopped fails in the session's hands a moment later
        self._tell(f"F{why}\n")
        start_s = time.monotonic()
        said_s = -SAY_S
        problem = self._stopped()
        while problem and time.monotonic() - start_s < self._order["try_s"]:
            if self._simulation_over():
                # nothing is left that could turn
                return
            if time.monotonic() - said_s >= SAY_S:
                said_s = time.monotonic()
                say(f"STOP THE MOTOR BY HAND: the guard cannot confirm the safe state ({problem})")
                let_go_of_pipes()
            time.sleep(5 * POLL_S)
            problem = self._stopped()
        took_s = time.monotonic() - start_s
        write_down(self._order["log"], why, problem, took_s)
        if problem:
            say(f"PRESS THE EMERGENCY STOP: the guard could not stop the motor ({problem})")
        else:
            say(f"{why}; the guard has stopped the motor within {took_s:.2f} s, confirmed")

    def _stopped(self) -> str:
        """Try once; return why the motor is not known to stand. Nothing ends the trying."""
        try:
            self._listen()
            # a session that is gone leaves its serial port; one that is only frozen has it still
            return stop_motor(self._order, alone=self._alone)
        except Exception as error:  # noqa: BLE001 - a bug here must not leave a motor on
            return f"{type(error).__name__}: {error}"

    def _simulation_over(self) -> bool:
        """Return whether this guarded an emulator that has ended."""
        if self._emulator is None:
            return False
        try:
            return not self._emulator.recv(1)
        except BlockingIOError:
            return False
        except OSError:
            return True

    def _tell(self, words: str) -> None:
        with contextlib.suppress(OSError):
            self._link.send(words.encode(errors="replace"))


def main() -> NoReturn:
    """Take the order, watch, act if need be."""
    # what ends the session must not end the guard before it has done its work
    ignore_signals()
    try:
        port, secret = sys.stdin.readline().split()
        link = dial(("127.0.0.1", int(port)), CONNECT_S)
        link.settimeout(None)
        link.sendall(secret.encode())
    except (OSError, ValueError):
        # the session is gone already, and nothing has moved
        sys.exit(0)
    with link.makefile("rb", buffering=0) as words:
        line = words.readline()
    if not line.endswith(b"\n"):
        sys.exit(0)
    guard = Watcher(link, json.loads(line))
    guard.prepare()
    sys.exit(guard.watch())
