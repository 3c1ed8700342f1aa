"""Put faults between a host and a device that already runs: on TCP, or on a serial line.

For example, one reply in ten comes too late::

    with faulty_tcp(host, port, Mangler("late", TcpFraming(), share=0.1, late_s=0.4)) as near:
        ...  # the host connects to `near`, a pair of host and port

Requests pass as they are; what the device sends goes through the `Mangler`.
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
import os
import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from hdbench.devices.emulator.faults import Delivery, Mangler

__all__ = ["faulty_serial", "faulty_tcp"]

_CHUNK = 65536
_CONNECT_S = 5.0
# how soon a pump notices that its line has ended, s
_GRAIN_S = 0.05

Read = Callable[[], bytes]
Write = Callable[[bytes], None]


class _Outlet:
    """Delivers pieces in the order of their times, from a thread of its own."""

    def __init__(self, write: Write, end: Callable[[str], None]) -> None:
        self._write = write
        self._end = end
        self._heap: list[tuple[float, int, Delivery]] = []
        self._order = itertools.count()
        self._changed = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def put(self, pieces: list[Delivery]) -> None:
        now_s = time.monotonic()
        with self._changed:
            for piece in pieces:
                heapq.heappush(self._heap, (now_s + piece.after_s, next(self._order), piece))
            self._changed.notify()

    def close(self) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify()

    def _run(self) -> None:
        # the other side may hang up at any moment
        with contextlib.suppress(OSError):
            while (piece := self._next()) is not None:
                self._deliver(piece)

    def _next(self) -> Delivery | None:
        with self._changed:
            while not self._ended:
                if not self._heap:
                    self._changed.wait()
                    continue
                wait_s = self._heap[0][0] - time.monotonic()
                if wait_s <= 0.0:
                    return heapq.heappop(self._heap)[2]
                self._changed.wait(wait_s)
        return None

    def _deliver(self, piece: Delivery) -> None:
        if piece.per_byte_s:
            for byte in piece.data:
                time.sleep(piece.per_byte_s)
                self._write(bytes((byte,)))
        elif piece.data:
            self._write(piece.data)
        if piece.then:
            self._end(piece.then)


def _copy(read: Read, write: Write, end: Callable[[], None]) -> None:
    """Pass bytes until one side ends."""
    with contextlib.suppress(OSError):
        while data := read():
            write(data)
    end()


def _mangle(read: Read, outlet: _Outlet, mangler: Mangler, end: Callable[[], None]) -> None:
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
        outlet = _Outlet(near.sendall, self._hang_up)
        _thread(_copy, _receiver(near), far.sendall, self.close)
        _thread(_mangle, _receiver(far), outlet, mangler, self.close)

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


def _thread(act: Callable[..., None], *parts: object) -> None:
    threading.Thread(target=act, args=parts, daemon=True).start()


@contextmanager
def faulty_tcp(host: str, port: int, mangler: Mangler) -> Iterator[tuple[str, int]]:
    """Stand between hosts and a device on TCP.

    Parameters
    ----------
    host, port : str and int
        The device.
    mangler : Mangler
        Applied to every frame from the device to a host.

    Yields
    ------
    tuple of str and int
        Host and port for a host to connect to.

    Raises
    ------
    OSError
        If no port can be used.
    """
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


@contextmanager
def faulty_serial(path: str, mangler: Mangler) -> Iterator[str]:
    """Stand between a host and a device on a pseudo-terminal (POSIX only).

    Parameters
    ----------
    path : str
        The device's terminal.
    mangler : Mangler
        Applied to every frame from the device to the host.

    Yields
    ------
    str
        The terminal for the host to open.

    Raises
    ------
    OSError
        If the terminal cannot be opened.
    """
    import tty

    far = os.open(path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(far)
    near, slave = os.openpty()
    tty.setraw(slave)
    ended = threading.Event()
    outlet = _Outlet(lambda data: _write_all(near, data), lambda _: ended.set())
    threads = (
        threading.Thread(
            target=_copy,
            args=(_reader(near, ended), lambda data: _write_all(far, data), ended.set),
        ),
        threading.Thread(target=_mangle, args=(_reader(far, ended), outlet, mangler, ended.set)),
    )
    for thread in threads:
        thread.start()
    try:
        yield os.ttyname(slave)
    finally:
        ended.set()
        for thread in threads:
            thread.join()
        for descriptor in (near, slave, far):
            os.close(descriptor)


def _reader(descriptor: int, ended: threading.Event) -> Read:
    """Return a read that ends once `ended` is set."""

    def read() -> bytes:
        while not ended.is_set():
            if select.select([descriptor], [], [], _GRAIN_S)[0]:
                return os.read(descriptor, _CHUNK)
        return b""

    return read


def _write_all(descriptor: int, data: bytes) -> None:
    while data:
        data = data[os.write(descriptor, data) :]
