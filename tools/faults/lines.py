"""Lines that spoil what a device sends: on TCP, or on a serial line.

For example, one reply in ten comes too late::

    with faulty_tcp(host, port, Mangler("late", TcpFraming(), share=0.1, late_s=0.4)) as near:
        ...  # the host connects to `near`, a pair of host and port

Requests pass as they are; what the device sends goes through the `Mangler`.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import heapq
import itertools
import os
import select
import socket
import struct
import threading
import time
import tty
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Any

from faults.mangler import Delivery, Mangler
from hdbench.devices.emulator.server import Device, ModbusServer, Wire
from hdbench.system.lines import terminal_pair

__all__ = [
    "Deadlines",
    "Outlet",
    "behind",
    "emulated",
    "faulty_serial",
    "faulty_tcp",
    "in_thread",
]


class Outlet:
    """Delivers pieces in the order of their times, from a thread of its own.

    Parameters
    ----------
    write : callable
        Sends bytes.
    end : callable
        Hangs up, in the way that a piece asks for.
    """

    def __init__(self, write: Callable[[bytes], None], end: Callable[[str], None]) -> None:
        self._write = write
        self._end = end
        self._heap: list[tuple[float, int, Delivery]] = []
        self._order = itertools.count()
        self._changed = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def put(self, pieces: list[Delivery]) -> None:
        """Deliver pieces, each after its time."""
        now_s = time.monotonic()
        with self._changed:
            for piece in pieces:
                heapq.heappush(self._heap, (now_s + piece.after_s, next(self._order), piece))
            self._changed.notify()

    def close(self) -> None:
        """Deliver nothing more; what is being written now may still end."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    @property
    def runs(self) -> bool:
        """Whether something may still be written."""
        return self._thread.is_alive()

    def join(self) -> None:
        """Wait until nothing more will be written."""
        self._thread.join()

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
                if self._ends_within(piece.per_byte_s):
                    return
                self._write(bytes((byte,)))
        elif piece.data:
            self._write(piece.data)
        if piece.then:
            self._end(piece.then)

    def _ends_within(self, wait_s: float) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: self._ended, wait_s)


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
    """Open a pseudo-terminal, for this process alone; it passes every character as it is."""
    descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY)
    # a guard that still looks for a device that has ended leaves it in peace then
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    tty.setraw(descriptor)
    return descriptor


def _reader(descriptor: int, ended: threading.Event) -> Read:
    """Return a read that ends once `ended` is set."""

    def read() -> bytes:
        while not ended.is_set():
            if select.select([descriptor], (), (), _GRAIN_S)[0]:
                # whoever else opens the line may take what was there, or change its settings
                with contextlib.suppress(BlockingIOError):
                    if data := os.read(descriptor, _CHUNK):
                        return data
        return b""

    return read


def _write_all(descriptor: int, data: bytes) -> None:
    while data:
        data = data[os.write(descriptor, data) :]


# what deadlines are to be kept within
OVER = 1.1


class Deadlines:
    """Counts how calls keep their deadline.

    Parameters
    ----------
    deadline_s : float
        Of one call, s.

    Attributes
    ----------
    over, held_up : int
        Calls of more than 1.1 deadlines, and those among them that are within it without the time
        for which threads of this process - device, line and host - were ready to run and had no
        processor.
    worst : float
        Longest call over its deadline.
    """

    def __init__(self, deadline_s: float) -> None:
        self.over = self.held_up = 0
        self.worst = 0.0
        self._deadline_s = deadline_s

    @contextmanager
    def call(self, allowed: float = 1.0) -> Iterator[None]:
        """Time one call of `allowed` deadlines."""
        waited_s, start_s = _ready_s(), time.monotonic()
        try:
            yield
        finally:
            took_s = time.monotonic() - start_s
            limit_s = allowed * self._deadline_s
            self.worst = max(self.worst, took_s / limit_s)
            if took_s > OVER * limit_s:
                self.over += 1
                self.held_up += took_s - (_ready_s() - waited_s) <= OVER * limit_s


def _ready_s() -> float:
    """Return how long threads of this process have waited for a processor so far, s."""
    total_ns = 0
    for thread in os.listdir("/proc/self/task"):
        try:
            with open(f"/proc/self/task/{thread}/schedstat", encoding="ascii") as file:
                total_ns += int(file.read().split()[1])
        except OSError:
            continue
    return 1e-9 * total_ns


@contextmanager
def in_thread(
    start: Callable[[], Coroutine[Any, Any, Any]], close: Callable[[], None]
) -> Iterator[tuple[asyncio.AbstractEventLoop, Any]]:
    """Await `start` in a new thread; yield its loop and what `start` gave, `close` there later."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()

    async def shut() -> None:
        close()
        # one turn of the loop closes what is open
        await asyncio.sleep(0.01)

    try:
        yield loop, asyncio.run_coroutine_threadsafe(start(), loop).result(5)
    finally:
        asyncio.run_coroutine_threadsafe(shut(), loop).result(5)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(5)
        loop.close()


@contextmanager
def emulated(device: Device, wire: Wire = "tcp") -> Iterator[str]:
    """Serve an emulated device in a thread; yields its address."""
    server = ModbusServer(device, wire)
    with in_thread(server.open, server.close) as (_, address):
        yield address


@contextmanager
def behind(address: str, mangler: Mangler) -> Iterator[str]:
    """Put faults before a device; yields the address for the host."""
    scheme, _, rest = address.partition("://")
    if scheme == "rtu":
        with faulty_serial(rest, mangler) as path:
            yield f"rtu://{path}"
        return
    host, _, port = rest.rpartition(":")
    with faulty_tcp(host, int(port), mangler) as (near, near_port):
        yield f"{scheme}://{near}:{near_port}"
