"""Guard process as its session sees it: started, given signs of life, asked, let go."""

from __future__ import annotations

import secrets
import select
import socket
import subprocess
import sys
import time
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from hdbench.devices.guard.order import GuardOrder, as_json
from hdbench.errors import DeviceError
from hdbench.system.processes import DETACHED

# behind the standard library: the guard itself, this package, and pyserial
_PATHS = [str(Path(__file__).parents[at]) for at in (0, 3)]
_PATHS += [str(Path(str(found.origin)).parents[1]) for found in (find_spec("serial"),) if found]
_PROGRAM = f"import sys; sys.path += {_PATHS!r}; from process.watching import main; main()"
_WHERE = "guard process"
# a cold start of the interpreter; seconds only on a machine that is swamped
_START_S = 20.0
_END_S = 2.0
_GRAIN_S = 0.1
# a guard that has not answered a sign of life for this long hangs, s
_DEAF_S = 2.0
# signs of life per longest silence
_BEATS = 8.0
# a frozen session is to be noticed within this time where its watchdog allows more, s
_SILENCE_S = 0.5

Watch = Literal["closely", "patiently", "end-only"]
_LETTERS: dict[Watch, bytes] = {"closely": b"A", "patiently": b"L", "end-only": b"I"}


def guard_silence_s(watchdog_s: float, deadline_s: float) -> float:
    """Return after which silence of the session the guard acts, s.

    Parameters
    ----------
    watchdog_s : float
        Host silence after which the device itself acts, s.
    deadline_s : float
        Longest time one call to the device may take, s.

    Returns
    -------
    float
        Shorter than the device's watchdog, at most 0.5 s, but longer than one call.
    """
    return max(1.2 * deadline_s, min(0.9 * watchdog_s, _SILENCE_S))


class GuardProcess:
    """A process that stops the motor when this one dies or freezes.

    Parameters
    ----------
    order : GuardOrder
        What it sends and reads.
    silence_s : float
        Longest time between two signs of life while the motor may turn, s.
    log : Path or None
        File that it notes in what it did.
    emulator : str, optional
        Control channel of the emulator that it guards: kept open, so that the emulator lives until
        its motor was seen standing, and so that its end is noticed.

    Raises
    ------
    DeviceError
        If it does not start, or does not reach the device: nothing may move then.

    Notes
    -----
    Ctrl-C does not reach it. It talks with this process over a loopback connection: it is told port
    and a secret word on its standard input, and says that word first.
    """

    def __init__(
        self,
        order: GuardOrder,
        silence_s: float,
        *,
        log: Path | None = None,
        emulator: str | None = None,
    ) -> None:
        self.silence_s = silence_s
        try:
            with socket.create_server(("127.0.0.1", 0)) as listener:
                self._process: subprocess.Popen[bytes] = subprocess.Popen(
                    [sys.executable, "-I", "-S", "-c", _PROGRAM],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL,
                    **DETACHED,
                )
                self._link = self._called(listener)
        except OSError as error:
            raise _fault(f"it cannot be started ({error.strerror or error})") from error
        self._watch: Watch = "end-only"
        self._said_s = self._heard_s = time.monotonic()
        self._words = b""
        told = str(log.absolute()) if log else None
        line = as_json(order, silence_s=silence_s, log=told, emulator=emulator)
        self._hand_over(line.encode() + b"\n")

    @property
    def pid(self) -> int:
        """Number of its process."""
        return self._process.pid

    def watch(self, how: Watch) -> None:
        """Say how closely it is to watch from now on.

        Parameters
        ----------
        how : {"closely", "patiently", "end-only"}
            ``closely``: signs of life every moment; ``patiently``: while this process brakes the
            motor by itself, 6 s at most; ``end-only``: nothing moves.

        Raises
        ------
        DeviceError
            If the guard has ended, or has already acted.
        """
        self._watch = how
        self._heard_s = time.monotonic()
        self._send(_LETTERS[how])
        self.check()

    def beat(self) -> None:
        """Give a sign of life, and make sure that the guard still gives its own.

        Raises
        ------
        DeviceError
            As for `watch`.
        """
        now_s = time.monotonic()
        if now_s - self._said_s >= self.silence_s / _BEATS:
            self._said_s = now_s
            self._send(b".")
            self.check()

    def check(self) -> None:
        """Raise if the guard has ended, hangs, or has acted.

        Raises
        ------
        DeviceError
            What became of it.
        """
        self._read(0.0)
        for line in self._words.split(b"\n"):
            word = line.lstrip(b".")
            if word[:1] == b"F":
                raise _fault(
                    f"it stops the motor: {word[1:].decode('ascii', 'replace')}",
                    "look for what held this computer up, then run again",
                )
        self._words = self._words.rpartition(b"\n")[2].lstrip(b".")
        if self._watch != "end-only" and not time.monotonic() - self._heard_s < _DEAF_S:
            raise _fault(f"it has not answered for {_DEAF_S:g} s")

    def end(self) -> None:
        """Let it go: the safe state was confirmed. Never raises."""
        with suppress(OSError):
            self._link.send(b"Q")
            self._link.shutdown(socket.SHUT_WR)
            self._link.settimeout(_END_S)
            # a connection that is closed over words unread would be reset, the last one lost
            while self._link.recv(4096):
                pass
        self._link.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._give_up()

    def abandon(self) -> None:
        """Leave it to its work: nobody has confirmed the safe state. Never raises.

        Notes
        -----
        A device that answers is safe within this call; at one that does not, the guard goes on
        trying by itself.
        """
        self._link.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_S)

    def _called(self, listener: socket.socket) -> socket.socket:
        """Tell the process where to call, and return its connection."""
        secret = secrets.token_hex(16).encode()
        stdin = self._process.stdin
        if stdin is not None:
            with suppress(OSError), stdin:
                stdin.write(b"%d %s\n" % (listener.getsockname()[1], secret))
        until_s = time.monotonic() + _START_S
        listener.settimeout(_GRAIN_S)
        while self._process.poll() is None and time.monotonic() < until_s:
            with suppress(TimeoutError):
                link, _ = listener.accept()
                if _said(link, len(secret)) == secret:
                    link.settimeout(None)
                    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    return link
                link.close()
        self._process.kill()
        self._process.wait()
        raise _fault("it does not start")

    def _hand_over(self, order: bytes) -> None:
        """Hand the order over, and wait until the guard knows the device."""
        try:
            self._link.sendall(order)
        except OSError as error:
            self._give_up()
            raise _fault(f"it does not take its order ({error.strerror})") from error
        until_s = time.monotonic() + _START_S
        while b"\n" not in self._words:
            left_s = until_s - time.monotonic()
            try:
                if not left_s > 0.0:
                    raise _fault(f"it was not ready within {_START_S:g} s")
                self._read(left_s)
            except DeviceError:
                self._give_up()
                raise
        answer, _, self._words = self._words.partition(b"\n")
        if answer[:1] != b"R":
            self._give_up()
            raise _fault(
                f"it does not reach the device: {answer[1:].decode('ascii', 'replace')}",
                "let the device take a second connection, then run again",
            )

    def _give_up(self) -> None:
        self._process.kill()
        self._process.wait()
        self._link.close()

    def _send(self, word: bytes) -> None:
        try:
            # where it reads no more, `check` notices by its silence
            if select.select([], [self._link], [], 0.0)[1]:
                self._link.send(word)
        except OSError as error:
            raise _fault(f"it has ended ({error.strerror})") from error

    def _read(self, wait_s: float) -> None:
        while select.select([self._link], [], [], wait_s)[0]:
            wait_s = 0.0
            try:
                words = self._link.recv(4096)
            except OSError:
                words = b""
            if not words:
                raise _fault("it has ended")
            self._heard_s = time.monotonic()
            self._words += words


def _said(link: socket.socket, size: int) -> bytes:
    """Return the first words of a caller who does not dawdle."""
    words = b""
    link.settimeout(_GRAIN_S)
    with suppress(OSError):
        while len(words) < size and (piece := link.recv(size - len(words))):
            words += piece
    return words


def _fault(what: str, fix: str = "") -> DeviceError:
    return DeviceError(
        f"the guard process that would stop the motor: {what}",
        where=_WHERE,
        fix=fix or "run again; if it stays, free this computer of other work",
    )
