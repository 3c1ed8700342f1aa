"""Put faults between a host and a device that already runs: on TCP, or on a serial line.

For example, one reply in ten comes too late::

    with faulty_tcp(host, port, Mangler("late", TcpFraming(), share=0.1, late_s=0.4)) as near:
        ...  # the host connects to `near`, a pair of host and port

Requests pass as they are; what the device sends goes through the `Mangler`.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from hdbench.system.lines import terminal_pair
from linefaults.faults import Mangler
from linefaults.outlet import Outlet

__all__ = ["faulty_serial", "faulty_tcp"]

_CHUNK = 65536
_CONNECT_S = 5.0
# how soon a pump notices that its line has ended, s
_GRAIN_S = 0.05

Read = Callable[[], bytes]


def _copy(read: Read, write: Callable[[bytes], None], end: Callable[[], None]) -> None:
    """Pass bytes until one side ends."""
    with contextlib.suppress(OSError):
        while data := read():
            write(data)
    end()


def _mangle(read: Read, outlet: Outlet, mangler: Mangler, end: Callable[[], None]) -> None:
    """Pass frames through `mangler` until the device ends."""
    buffer = bytearray()
    with contextlib.suppress(OSError):
        while data := read():
            buffer += data
            for frame in mangler.framing.split(buffer):
                outlet.put(mangler(frame))
    outlet.close()
    end()


class _Pair:
    """One connection of a host, and the one behind it to the device."""

    def __init__(self, near: socket.socket, far: socket.socket, mangler: Mangler) -> None:
        self._near, self._far = near, far
        near.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        far.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._outlet = Outlet(near.sendall, self._hang_up)
        self._threads = (
            _thread(_copy, _receiver(near), far.sendall, self.close),
            _thread(_mangle, _receiver(far), self._outlet, mangler, self.close),
        )

    @property
    def serves(self) -> bool:
        """Whether anything of it still runs."""
        return self._outlet.runs or any(thread.is_alive() for thread in self._threads)

    def join(self) -> None:
        """Wait for what serves this connection, which was closed before."""
        for thread in self._threads:
            thread.join()
        self._outlet.join()

    def close(self) -> None:
        for each in (self._near, self._far):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _hang_up(self, how: str) -> None:
        if how == "reset":
            linger = struct.pack("ii", 1, 0)
            self._near.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
            self._near.close()
        self.close()


def _receiver(line: socket.socket) -> Read:
    """Return a read that is never inside the socket while another thread resets it."""

    def read() -> bytes:
        while line.fileno() >= 0:
            try:
                ready = select.select([line], [], [], _GRAIN_S)[0]
            except ValueError:
                # closed between the two lines above
                return b""
            if ready:
                return line.recv(_CHUNK)
        return b""

    return read


def _thread(act: Callable[..., None], *parts: object) -> threading.Thread:
    thread = threading.Thread(target=act, args=parts, daemon=True)
    thread.start()
    return thread


@contextmanager
def faulty_tcp(host: str, port: int, mangler: Mangler) -> Iterator[tuple[str, int]]:
    """Stand between hosts and a device on TCP."""
    listener = socket.create_server(("127.0.0.1", 0))
    pairs: list[_Pair] = []

    def accept() -> None:
        while True:
            try:
                near, _ = listener.accept()
            except OSError:
                return
            try:
                far = socket.create_connection((host, port), timeout=_CONNECT_S)
            except OSError:
                near.close()
                continue
            far.settimeout(None)
            pairs[:] = [pair for pair in pairs if pair.serves]
            pairs.append(_Pair(near, far, mangler))

    thread = threading.Thread(target=accept, daemon=True)
    thread.start()
    try:
        name = listener.getsockname()
        yield str(name[0]), int(name[1])
    finally:
        with contextlib.suppress(OSError):
            listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join(_CONNECT_S)
        for pair in pairs:
            pair.close()
        for pair in pairs:
            pair.join()


@contextmanager
def faulty_serial(path: str, mangler: Mangler) -> Iterator[str]:
    """Stand between a host and a device on a pseudo-terminal (POSIX only)."""
    far = open_terminal(path)
    near, slave, here = terminal_pair()
    ended = threading.Event()

    def deliver(data: bytes) -> None:
        # where nobody reads, the line is full and the rest is lost as on a real one
        with contextlib.suppress(BlockingIOError):
            _write_all(near, data)

    outlet = Outlet(deliver, lambda _: ended.set())
    threads = (
        _thread(_copy, _reader(near, ended), lambda data: _write_all(far, data), ended.set),
        _thread(_mangle, _reader(far, ended), outlet, mangler, ended.set),
    )
    try:
        yield here
    finally:
        ended.set()
        for thread in threads:
            thread.join()
        # a number that is closed may be another file's a moment later
        outlet.join()
        for descriptor in (near, slave, far):
            os.close(descriptor)


def open_terminal(path: str) -> int:
    """Open a pseudo-terminal by its path, so that it passes every character as it is."""
    descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(descriptor)
    return descriptor


def _reader(descriptor: int, ended: threading.Event) -> Read:
    """Return a read that ends once `ended` is set."""

    def read() -> bytes:
        while not ended.is_set():
            if select.select([descriptor], (), (), _GRAIN_S)[0]:
                return os.read(descriptor, _CHUNK)
        return b""

    return read


def _write_all(descriptor: int, data: bytes) -> None:
    while data:
        data = data[os.write(descriptor, data) :]
