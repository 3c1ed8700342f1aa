"""The serial port: a thread takes what comes, so that the device's small buffer never fills."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from hdbench.errors import DeviceError, UsageError
from hdbench.system.lines import PortIo, is_port, open_port, port_io

if TYPE_CHECKING:
    from serial import Serial

__all__ = ["Chunk", "Port", "port_path"]

Chunk = tuple[bytes, float]
"""Bytes and the host's clock when they came, s."""

# the instrument's virtual port ignores the bit rate
_BAUD = 115200
_CHUNK = 65536
_GRAIN_S = 0.05
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
    """Bytes to and from one serial port; opened when needed.

    Parameters
    ----------
    path : str
        The port.
    clock : callable, optional
        Monotonic clock, s.
    """

    def __init__(self, path: str, *, clock: Callable[[], float] = time.monotonic) -> None:
        self.where = f"serial://{path}"
        self._path = path
        self._clock = clock
        self._io: PortIo | None = None
        self._thread: threading.Thread | None = None
        self._changed = threading.Condition()
        self._chunks: deque[Chunk] = deque()
        self._ended = threading.Event()
        self._fault = ""

    def send(self, data: bytes, until_s: float) -> None:
        """Send all bytes."""
        io = self._opened()
        try:
            while data:
                left_s = until_s - self._clock()
                if not left_s > 0.0 or not io.writable(left_s):
                    raise self._error("the port takes no characters")
                data = data[io.write(data) :]
        except OSError as error:
            raise self._error(f"the port failed ({error.strerror or error})") from error

    def receive(self, until_s: float) -> list[Chunk]:
        """Return what has come; waits until something has, or until `until_s`."""
        self._opened()
        with self._changed:
            left_s = until_s - self._clock()
            if not self._chunks and not self._fault and left_s > 0.0:
                self._changed.wait(left_s)
            chunks = list(self._chunks)
            self._chunks.clear()
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
                    self._chunks.append((data, self._clock()))
                self._fault = fault
                if data or fault:
                    self._changed.notify_all()

    def _error(self, what: str) -> DeviceError:
        return DeviceError(what, where=f"DATAQ {self.where}", fix=_FIX)
