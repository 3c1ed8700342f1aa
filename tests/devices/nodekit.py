"""A tiny bench, a node served in a thread, and a Modbus server that misbehaves on order."""

import itertools
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from changing import REPORT, with_keys
from daqkit import Clock
from faults.lines import emulated
from forked import forked
from served import begin, read_samples

from hdbench.devices import AcquisitionSettings, open_bench
from hdbench.devices.emulator.node import NodeCore, build_core
from hdbench.devices.emulator.process import running_emulator
from hdbench.devices.feasibility import host_settings
from hdbench.devices.host.bench import HostedBench
from hdbench.devices.node.access import NodeAccess, node_probe
from hdbench.devices.node.driver import NodeDaq
from hdbench.devices.wire.address import parse_address
from hdbench.devices.wire.link import connect
from hdbench.plant.converter import RawSamples
from hdbench.profile.schema import ReferenceWave

# how often `until` looks, s
_GRAIN_S = 0.005
# an encoder so fine that its counts between two samples need more than 16 bits
PROFILE = with_keys(REPORT, encoder={"counts_per_turn": 2_000_000})
# a bench at an address, where another process takes the processor for a while
PATIENT = with_keys(PROFILE, daq={"deadline_s": 1.5, "watchdog_s": 2.0})
VELOCITY_PER_VOLT = PROFILE.servo.velocity_gain_rad_s_per_v


realtime_emulator = partial(running_emulator, plant="as-modelled", seed=0, pace="realtime")


class TinyBench:
    """Counts up in every channel; the motor follows its reference with a lag of 20 ms."""

    def __init__(self) -> None:
        self.begun: list[object] = []
        self.reference_v = 0.0
        self.velocity_rad_s = 0.0
        self.enabled = False
        self._count = 0
        self._period_s = 1e-3

    def begin(self, *, sample_period_s, wave, duration_s) -> None:
        self.begun.append((sample_period_s, wave, duration_s))
        self._period_s = sample_period_s
        self._count = 0
        self.enabled = wave is not None
        self.reference_v = wave.bias_v + wave.amplitude_v if wave else 0.0

    def halt(self) -> None:
        self.reference_v = 0.0

    def advance(self, n_samples: int) -> RawSamples:
        target = self.reference_v * VELOCITY_PER_VOLT
        decay = np.exp(-n_samples * self._period_s / 0.02)
        self.velocity_rad_s = target + (self.velocity_rad_s - target) * decay
        if self.reference_v == 0.0 and abs(self.velocity_rad_s) < 1e-3:
            self.velocity_rad_s, self.enabled = 0.0, False
        index = np.arange(self._count, self._count + n_samples)
        self._count += n_samples
        return RawSamples(*codes_of(index))


def codes_of(index: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return what TinyBench samples at `index`: torque, tacho, current, reference, encoder."""
    code = (index % 30011).astype(np.int16)
    return code, -code, (code // 3).astype(np.int16), (code // 7).astype(np.int16), index * -70_001


class ServedNode(NamedTuple):
    """A node in a thread of this process."""

    core: NodeCore
    host: str
    port: int


@contextmanager
def served(bench: object | None = None, *, pace: str = "fast") -> Iterator[ServedNode]:
    """Serve a node around `bench` on a free port."""
    core = build_core(bench or TinyBench(), PROFILE, 0, pace=pace)
    with emulated(core) as address:
        host, _, port = address.removeprefix("tcp://").rpartition(":")
        yield ServedNode(core, host, int(port))


def driver(
    host: str, port: int, *, deadline_s=1.0, watchdog_s=0.5, clock: Clock | None = None
) -> AbstractContextManager[HostedBench]:
    """Connect a driver; with `clock` its waits take no time."""
    waits = {} if clock is None else {"clock": clock, "sleep": clock.sleep}
    daq = NodeDaq(
        node_wire(host, port, deadline_s=deadline_s),
        exchanges_hz=lambda _: 1e6,
        tacho_rad_s_per_v=PROFILE.tacho.gain_rad_s_per_v,
        **waits,
    )
    return closing(HostedBench(daq, host_settings(PROFILE, watchdog_s=watchdog_s), **waits))


def node_wire(host: str, port: int, *, deadline_s: float) -> NodeAccess:
    """Return register access to a node on TCP."""
    link = connect(parse_address(f"tcp://{host}:{port}"), probe=node_probe)
    return NodeAccess(link, deadline_s=deadline_s)


def _turn(address: str, record: object, period_s: float, amplitude_v: float) -> None:
    """Turn a motor for ever; say the number of the guard once 400 samples have come."""
    wave = ReferenceWave(wave="constant", amplitude_v=amplitude_v)
    place = Path(str(record)) if record else None
    with open_bench(REPORT, address=address, realtime=True, record=place) as bench:
        begin(bench, AcquisitionSettings(period_s, 1_000_000, wave))
        read_samples(bench, 400)
        sys.stdout.write(f"{bench.guard.pid}\n")
        sys.stdout.flush()
        while True:
            bench.read_block()


@contextmanager
def host(
    address: str, *, record: object = "", period_s: float = 1e-3, amplitude_v: float = 1.0
) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """Turn a motor from a process; yields it and its guard's number after 400 samples."""
    process = forked(
        lambda: _turn(address, record, period_s, amplitude_v),
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    assert process.stdout is not None
    guard = 0
    try:
        guard = int(process.stdout.readline())
        yield process, guard
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        # its guard goes on trying, on a terminal that the next test may be given, until it has its
        # proof: the device must be there that long
        until(lambda: not Path(f"/proc/{guard}").exists(), 5.0)


Handler = Callable[[socket.socket, bytes], None]


@contextmanager
def rogue(
    handler: Handler, wrap: Callable[[socket.socket], socket.socket] = lambda plain: plain
) -> Iterator[tuple[str, int, list[bytes]]]:
    """Run `handler(connection, frame)` for every request frame; yields host, port, frames seen."""
    listener = socket.create_server(("127.0.0.1", 0))
    frames: list[bytes] = []
    connections: list[socket.socket] = []

    def talk(plain: socket.socket) -> None:
        with suppress(OSError):
            connection = wrap(plain)
            connections.append(connection)
            while frame := read_frame(connection):
                frames.append(frame)
                handler(connection, frame)

    def accept() -> None:
        with suppress(OSError):
            while True:
                connections.append(listener.accept()[0])
                threading.Thread(target=talk, args=(connections[-1],), daemon=True).start()

    thread = threading.Thread(target=accept, daemon=True)
    thread.start()
    try:
        yield (*listener.getsockname(), frames)
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join(5)
        for connection in connections:
            connection.close()


def read_frame(connection: socket.socket) -> bytes:
    """Return one whole Modbus TCP frame, or nothing at the end of the stream."""
    data, size = b"", 6
    while len(data) < size:
        chunk = connection.recv(size - len(data))
        data += chunk
        if len(data) == 6:
            size += int.from_bytes(data[4:6], "big")
        # the end, or no frame of Modbus TCP, such as the greeting of TLS
        if not chunk or (len(data) == 6 and size < 8):
            return b""
    return data


def adu(request: bytes, pdu: bytes, *, tid: int | None = None, unit: int | None = None) -> bytes:
    """Return `pdu` as a reply to `request`, with another number or unit where asked."""
    number = struct.unpack(">H", request[:2])[0] if tid is None else tid
    return struct.pack(">HHHB", number, 0, len(pdu) + 1, request[6] if unit is None else unit) + pdu


@contextmanager
def proxy(
    host: str, port: int, mangle: Callable[[int, bytes], bytes | None]
) -> Iterator[tuple[str, int, list[bytes]]]:
    """Pass frames to a node and back; `mangle(number, reply)` may change or swallow replies."""
    numbers = itertools.count(1)
    upstreams: dict[socket.socket, socket.socket] = {}

    def handler(connection: socket.socket, frame: bytes) -> None:
        if connection not in upstreams:
            far = socket.create_connection((host, port), timeout=5)
            upstreams[connection] = opened.enter_context(far)
        upstreams[connection].sendall(frame)
        changed = mangle(next(numbers), read_frame(upstreams[connection]))
        if changed is not None:
            connection.sendall(changed)

    with ExitStack() as opened, rogue(handler) as near:
        yield near


def until(condition: Callable[[], bool], timeout_s: float) -> float:
    """Wait for `condition`; return how long it took, or fail. A busy computer is given more."""
    for waits in range(round(timeout_s / _GRAIN_S)):
        if condition():
            return waits * _GRAIN_S
        time.sleep(_GRAIN_S)
    raise AssertionError(f"nothing happened within {timeout_s} s")


@contextmanager
def through(
    mangle: Callable[[int, bytes], bytes | None], *, deadline_s: float, watchdog_s: float = 2.0
) -> Iterator[tuple[HostedBench, ServedNode, list[bytes]]]:
    """Drive a node through a proxy; yields driver, node and the request frames."""
    with (
        served() as node,
        proxy(node.host, node.port, mangle) as (host, port, frames),
        driver(host, port, deadline_s=deadline_s, watchdog_s=watchdog_s) as bench,
    ):
        yield bench, node, frames
