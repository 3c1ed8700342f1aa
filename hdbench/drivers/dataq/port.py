"""Serial port with a reading thread, and the instrument's commands with their echoes."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from hdbench.devices.daq import clean_text
from hdbench.errors import DeviceError, UsageError
from hdbench.system.lines import PortIo, is_port, open_port, port_io

if TYPE_CHECKING:
    from serial import Serial

Chunk = tuple[bytes, float]
"""Bytes and the host's clock when they came, s."""

# the instrument's virtual port ignores the bit rate
_BAUD = 115200
_CHUNK = 65536
_GRAIN_S = 0.05
# of what nobody takes, bytes: at the highest rate what comes in 20 s
_MOST_WAITING = 4 << 20
_JOIN_S = 1.0
_FIX = "check cable and power; the instrument must be in its CDC mode, then run `hdbench doctor`"


def port_path(address: str) -> str:
    """Return the path of ``serial:///dev/NAME``."""
    path = address.removeprefix("serial://")
    if path == address or not is_port(path):
        raise UsageError(
            f"{address[:80]!r} is no serial port",
            where="address",
            fix="for example serial:///dev/ttyACM0 or, on Windows, serial://COM3",
        )
    return path


class Port:
    """Bytes to and from one serial port; opened when needed."""

    def __init__(self, path: str) -> None:
        self.where = f"serial://{path}"
        self._path = path
        self._io: PortIo | None = None
        self._thread: threading.Thread | None = None
        self._changed = threading.Condition()
        self._chunks: deque[Chunk] = deque()
        self._waiting = 0
        self._ended = threading.Event()
        self._fault = ""

    def send(self, data: bytes, until_s: float) -> None:
        """Send all bytes."""
        io = self._opened()
        try:
            while data:
                left_s = until_s - time.monotonic()
                if not left_s > 0.0 or not io.writable(left_s):
                    raise self._error("the port takes no characters")
                data = data[io.write(data) :]
        except OSError as error:
            raise self._error(f"the port failed ({error.strerror or error})") from error

    def receive(self, until_s: float) -> list[Chunk]:
        """Return what has come; waits until something has, or until `until_s`."""
        self._opened()
        with self._changed:
            left_s = until_s - time.monotonic()
            if not self._chunks and not self._fault and left_s > 0.0:
                self._changed.wait(left_s)
            chunks = list(self._chunks)
            self._chunks.clear()
            self._waiting = 0
        if not chunks and self._fault:
            raise self._error(self._fault)
        return chunks

    def close(self) -> None:
        """Close the port; never raises."""
        self._ended.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join(_JOIN_S)
        io, self._io = self._io, None
        if io is not None:
            with contextlib.suppress(OSError):
                io.close()

    def _opened(self) -> PortIo:
        if self._io is None:
            self._io = port_io(self._open())
            self._fault = ""
            self._ended.clear()
            self._chunks.clear()
            self._waiting = 0
            self._thread = threading.Thread(
                target=self._read, args=(self._io,), name="dataq-port", daemon=True
            )
            self._thread.start()
        return self._io

    def _open(self) -> Serial:
        try:
            return open_port(self._path, self.where, baud_bd=_BAUD)
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            raise self._error(f"the port cannot be opened ({why})") from error

    def _read(self, io: PortIo) -> None:
        """Take what comes until the port is closed or gone."""
        fault = ""
        while not self._ended.is_set() and not fault:
            try:
                data = io.read(_CHUNK) if io.readable(_GRAIN_S) else None
            except (OSError, ValueError) as error:
                data, fault = None, f"the port failed ({error})"
            if data == b"" and io.is_gone():
                fault = "the instrument was unplugged"
            with self._changed:
                if data:
                    self._chunks.append((data, time.monotonic()))
                    self._waiting += len(data)
                while self._waiting > _MOST_WAITING:
                    # a stream that lost so much is found out by its marks and by the clock
                    self._waiting -= len(self._chunks.popleft()[0])
                self._fault = fault
                if data or fault:
                    self._changed.notify_all()

    def _error(self, what: str) -> DeviceError:
        return DeviceError(what, where=f"DATAQ {self.where}", fix=_FIX)


_END = b"\r"
# an echo that was lost is asked for once more, each try within half of the deadline
_ATTEMPTS = 2
# after `stop` the line must have been quiet for this long, s
_QUIET_S = 0.03


class Commands:
    """Sends commands and checks what comes back.

    The instrument repeats every command, then a space and the value where there is one, then CR;
    only `start` is not repeated. A line that does not begin with the command is dropped: it belongs
    to an earlier one. All settings may be sent twice without harm.
    """

    def __init__(
        self, port: Port, *, deadline_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.where = f"DATAQ {port.where}"
        self.port = port
        self._deadline_s = deadline_s
        self._clock = clock

    def ask(self, command: str) -> str:
        """Send a command and return the value behind its echo; empty where there is none."""
        start_s = self._clock()
        for attempt in range(1, _ATTEMPTS + 1):
            until_s = start_s + self._deadline_s * attempt / _ATTEMPTS
            # what is still on its way belongs to an earlier command
            self.port.receive(0.0)
            self.port.send(command.encode() + _END, until_s)
            found = self._answer(command.encode(), until_s)
            if found is not None:
                return found
        raise self._error(f"{command!r} was not echoed", "check the instrument's cable and model")

    def set(self, command: str) -> None:
        """Send a setting; its echo must be the command and nothing else."""
        value = self.ask(command)
        if value:
            raise self._error(
                f"{command!r} was answered with {value[:40]!r}",
                "the instrument does not take this setting: compare it with its protocol",
            )

    def start(self) -> None:
        """Start scanning; sent once, never echoed."""
        self.port.receive(0.0)
        self.port.send(b"start 0" + _END, self._clock() + self._deadline_s)

    def stop(self) -> bytes:
        """Stop scanning and return the data that came before the echo."""
        until_s = self._clock() + self._deadline_s
        data = b""
        for attempt in range(1, _ATTEMPTS + 1):
            self.port.send(b"stop" + _END, until_s)
            half_s = until_s - self._deadline_s * (_ATTEMPTS - attempt) / _ATTEMPTS
            while self._clock() < half_s:
                quiet_s = min(half_s, self._clock() + _QUIET_S)
                chunks = self.port.receive(quiet_s)
                data += b"".join(chunk for chunk, _ in chunks)
                ended = data.rstrip(b"\n\0")
                if not chunks and ended.endswith(b"stop" + _END):
                    return ended.removesuffix(b"stop" + _END)
        raise self._error(
            "the instrument goes on after it was told to stop", "unplug it and plug it in again"
        )

    def close(self) -> None:
        """Close the port; never raises."""
        self.port.close()

    def _answer(self, command: bytes, until_s: float) -> str | None:
        """Return the value behind the echo of a command; None if it did not come in time."""
        data = b""
        while self._clock() < until_s:
            data += b"".join(chunk for chunk, _ in self.port.receive(until_s))
            *lines, data = data.split(_END)
            for line in lines:
                text = line.strip(b"\n\0 ")
                if text == command:
                    return ""
                if text.startswith(command + b" "):
                    return clean_text(text.removeprefix(command + b" "))
        return None

    def _error(self, what: str, fix: str) -> DeviceError:
        return DeviceError(f"{what} (deadline {self._deadline_s:g} s)", where=self.where, fix=fix)
