"""Measure how fast devices are read: nodes on a paced serial line and on TCP, polled ones on TCP.

Usage: python tools/bench/devices.py [--seconds 60] [--only serial|sustained|tcp|polled]

* serial: 1 kHz in real time over a line at the wire's pace: samples, losses, depth.
* sustained: as many blocks as go, beside a client that takes bytes as they come, in turns, and
  against the limit that characters and silences set.
* tcp: the driver against a client of raw sockets on the same server, in turns.
* polled: the link of polled devices against pymodbus as it comes, and against bare sockets, on the
  same server, in turns.

Servers of canned replies are tried on the client's own processor, where a hand-over costs least and
the clients show most, and on the other one, where two processors wake each other.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import multiprocessing
import os
import signal
import socket
import struct
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from hdbench.devices.daq import DaqSettings
from hdbench.devices.emulator.machine import BlockHeader, encode_block, encode_scans, seal_block
from hdbench.devices.node.driver import REPLY_CHARACTERS, REQUEST_CHARACTERS, open_node
from hdbench.devices.node.registers import block_registers, block_scans
from hdbench.devices.wire.address import parse_address
from hdbench.devices.wire.rtu import crc16
from hdbench.profile import load_profile

PROFILE = load_profile("cim-tr-97-06").data
ROLES = ("torque", "tacho", "encoder", "current", "reference")
TURNS = 6
PLACES: dict[str, Callable[[set[int]], int]] = {"one processor": min, "two processors": max}


@contextmanager
def process(*command: str) -> Iterator[str]:
    """Run a command; yields its first line."""
    child = subprocess.Popen([sys.executable, *command], stdout=subprocess.PIPE, text=True)
    try:
        yield child.stdout.readline().strip() if child.stdout else ""
    finally:
        child.send_signal(signal.SIGTERM)
        child.wait()


@contextmanager
def served(server: Callable[[Any], None], place: str = "anywhere") -> Iterator[int]:
    """Run a server in a process of its own, on the same or the other processor; yields its port."""
    port = multiprocessing.Value("i", 0)
    child = multiprocessing.Process(target=server, args=(port,), daemon=True)
    child.start()
    while not port.value:
        time.sleep(0.01)
    allowed = os.sched_getaffinity(0)
    if place in PLACES:
        os.sched_setaffinity(0, {min(allowed)})
        os.sched_setaffinity(child.pid or 0, {PLACES[place](allowed)})
    yield port.value
    os.sched_setaffinity(0, allowed)
    child.terminate()
    child.join()


def compared(ours: list[float], theirs: list[float]) -> dict[str, float]:
    """Return the medians of rates taken in turns, and of their ratios median and range."""
    ratio = np.array(ours) / np.array(theirs)
    return {
        "ours_per_s": round(float(np.median(ours))),
        "theirs_per_s": round(float(np.median(theirs))),
        "ratio_median": round(float(np.median(ratio)), 3),
        "ratio_min": round(float(ratio.min()), 3),
        "ratio_max": round(float(ratio.max()), 3),
    }


@contextmanager
def paced_node(pace: str, query: str) -> Iterator[str]:
    """Run a node behind a paced line; yields the host's address.

    In real time the emulated bench, else one whose samples cost nothing, so that the wire limits.
    """
    if pace == "fast":
        with process("tools/faults/paced.py", query) as near:
            yield near
        return
    with process("-m", "hdbench_cli", "emulate", "--rtu", "--pace", "realtime", "--json") as told:
        path = str(json.loads(told)["address"]).partition("?")[0]
        with process("tools/faults/paced.py", f"{path}?{query}") as near:
            yield near


def node(address: str, n_channels: int) -> Any:
    """Return the driver of a node."""
    table = PROFILE.daq.model_copy(
        update={"address": address, "channels": ROLES[:n_channels], "deadline_s": 1.0}
    )
    return open_node(PROFILE, table)


def serial(seconds: float) -> list[dict[str, object]]:
    """Acquire at 1 kHz in real time over paced lines."""
    rows = []
    for baud, n_channels in ((115200, 3), (921600, 5)):
        query = f"baud={baud}"
        with paced_node("realtime", query) as address:
            rows.append({"baud_bd": baud, **_acquire(address, n_channels, seconds)})
        print(json.dumps(rows[-1]), flush=True)
    return rows


def _acquire(address: str, n_channels: int, seconds: float) -> dict[str, object]:
    daq = node(address, n_channels)
    daq.claim()
    n_samples = round(1000 * seconds)
    daq.configure(DaqSettings(ROLES[:n_channels], 1e-3, n_samples, 2.0))
    start_s, cpu_s = time.monotonic(), time.process_time()
    daq.start()
    got = lost = depth = exchanges = 0
    while got + lost < n_samples:
        block = daq.read_block()
        exchanges += 1
        if block is not None:
            got, lost = got + len(block), lost + block.lost_before
            depth = max(depth, block.depth)
    took_s = time.monotonic() - start_s
    cpu_s = time.process_time() - cpu_s
    daq.safe_state()
    daq.close()
    return {
        "channels": n_channels, "samples": got, "lost": lost, "deepest": depth,
        "exchanges": exchanges, "took_s": round(took_s, 2),
        "host_cpu_share": round(cpu_s / took_s, 3),
    }  # fmt: skip


def sustained(seconds: float) -> list[dict[str, object]]:
    """Exchange full blocks as fast as the line allows."""
    rows = []
    for baud, n_channels, gap_us in (
        (115200, 3, None), (115200, 3, 1750), (921600, 5, None), (921600, 5, 1750),
    ):  # fmt: skip
        query = f"baud={baud}" + (f"&gap_us={gap_us}" if gap_us else "")
        with paced_node("fast", query) as address:
            line = parse_address(address).serial
            registers = block_registers(n_channels)
            limit_s = line.exchange_s(REQUEST_CHARACTERS, REPLY_CHARACTERS + 2 * registers)
            limit_hz = block_scans(n_channels) / limit_s
            turn_s = seconds / (2 * TURNS)
            taken = [
                (_fastest(address, n_channels, turn_s), _fastest_raw(address, n_channels, turn_s))
                for _ in range(TURNS)
            ]
        ours, raw = ([each[at] for each in taken] for at in range(2))
        rows.append({
            "baud_bd": baud, "channels": n_channels, "gap_ms": round(1e3 * line.silence_s, 3),
            "scans_per_s": compared(ours, raw), "wire_limit_scans_per_s": round(limit_hz, 1),
            "share": round(float(np.median(ours)) / limit_hz, 4),
        })  # fmt: skip
        print(json.dumps(rows[-1]), flush=True)
    return rows


def _fastest_raw(address: str, n_channels: int, seconds: float) -> float:
    """Return scans per second of a client without checks; the line itself keeps the silences."""
    daq = node(address, n_channels)
    _start(daq, n_channels)
    daq.close()
    count, ack, beat, number = block_registers(n_channels), 0, 0, 0
    descriptor = os.open(parse_address(address).path, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(descriptor)
    start_s = time.monotonic()
    while time.monotonic() - start_s < seconds:
        beat = beat % 0xFFFF + 1
        feed = struct.pack(">BBHHHHBHH", 1, 23, 0, count, 0x1000, 2, 4, ack, beat)
        os.write(descriptor, feed + crc16(feed))
        data = b""
        while len(data) < REPLY_CHARACTERS + 2 * count:
            data += os.read(descriptor, 4096)
        ack = struct.unpack_from(">H", data, 7)[0] or ack
        number += struct.unpack_from(">H", data, 11)[0]
    os.close(descriptor)
    return number / (time.monotonic() - start_s)


def _start(daq: Any, n_channels: int) -> None:
    daq.safe_state()
    daq.configure(DaqSettings(ROLES[:n_channels], 1e-3, 100_000_000, 2.0))
    daq.start()


def _fastest(address: str, n_channels: int, seconds: float) -> float:
    daq = node(address, n_channels)
    daq.claim()
    _start(daq, n_channels)
    for _ in range(5):
        daq.read_block()
    got, start_s = 0, time.monotonic()
    while time.monotonic() - start_s < seconds:
        block = daq.read_block()
        got += len(block) if block is not None else 0
    rate_hz = got / (time.monotonic() - start_s)
    daq.safe_state()
    daq.close()
    return rate_hz


def tcp(seconds: float) -> dict[str, object]:
    """Compare the driver with raw sockets, in turns, on one and the same server."""
    row: dict[str, object] = {}
    with process("-m", "hdbench_cli", "emulate", "--pace", "fast", "--json") as told:
        port = int(json.loads(told)["port"])
        row["emulated bench"] = _compare(port, seconds / 3, lambda: _started(port))
    with process("tools/faults/replies.py", "--serve", "tcp") as told:
        port = parse_address(json.loads(told)["address"]).port
        row["counting node"] = _compare(port, seconds / 3, lambda: _started(port))
    for place in PLACES:
        with served(_block_server, place) as port:
            row[f"canned blocks, {place}"] = _compare(port, seconds / 3, lambda: 1)
    print(json.dumps(row), flush=True)
    return row


def _started(port: int) -> int:
    """Start an acquisition on the emulated node and return its number."""
    daq = node(f"tcp://127.0.0.1:{port}", 5)
    _start(daq, 5)
    run = int(daq.status()["starts"])
    daq.close()
    return run


def _compare(port: int, seconds: float, start: Callable[[], int]) -> dict[str, object]:
    turn_s = seconds / (4 * TURNS)
    rates: dict[tuple[str, bool], list[float]] = {}
    for _ in range(TURNS):
        for decode in (False, True):
            rates.setdefault(("raw", decode), []).append(
                _raw_rate(port, turn_s, start(), decode=decode)
            )
            rates.setdefault(("driver", decode), []).append(
                _driver_rate(port, turn_s, start(), decode=decode)
            )
    row: dict[str, object] = {}
    for decode, what in ((False, "bytes"), (True, "values")):
        found = compared(rates["driver", decode], rates["raw", decode])
        row[what] = {**found, "scans_per_s": found["ours_per_s"] * block_scans(5)}
    return row


def _windows() -> list[bytes]:
    """Return windows of full blocks 1 to 64, five channels, without echo."""
    index = np.arange(block_scans(5))
    codes = np.column_stack([index + k for k in range(4)]).astype(np.int16)
    scans = encode_scans(codes, index * 7)
    return [
        encode_block(BlockHeader(1, seq, 2, 99, (seq - 1) * len(index), 0x2F), scans)
        for seq in range(1, 65)
    ]


def _block_server(port: Any) -> None:
    """Answer FC23 with the next block as fast as Python goes."""
    template = _windows()[0]
    size = 2 * block_registers(5)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port.value = listener.getsockname()[1]
        while True:
            connection, _ = listener.accept()
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with connection:
                _serve_blocks(connection, template, size)


def _serve_blocks(connection: socket.socket, template: bytes, size: int) -> None:
    scans = block_scans(5)
    while request := connection.recv(4096):
        ack, beat = struct.unpack(">HH", request[-4:])
        seq = ack % 0xFFFF + 1
        window = bytearray(template)
        struct.pack_into(">H", window, 4, seq)
        struct.pack_into(">I", window, 12, (seq - 1) * scans)
        reply = b"\x17" + bytes((size,)) + seal_block(bytes(window), beat)[:size]
        connection.sendall(request[:2] + struct.pack(">HHB", 0, len(reply) + 1, 1) + reply)


def _raw_rate(port: int, seconds: float, run: int, *, decode: bool) -> float:
    """Return exchanges per second of raw sockets: acknowledged bytes, or values in volts."""
    connection = socket.create_connection(("127.0.0.1", port))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    count, ack, beat, number = block_registers(5), 0, 0, 0
    size = 9 + 2 * count
    start_s, n = time.monotonic(), 0
    while time.monotonic() - start_s < seconds:
        number, beat = number % 0xFFFF + 1, beat % 0xFFFF + 1
        connection.sendall(
            struct.pack(">HHHBBHHHHBHH", number, 0, 15, 1, 23, 0, count, 0x1000, 2, 4, ack, beat)
        )
        data = b""
        while len(data) < size:
            data += connection.recv(4096)
        ack = struct.unpack_from(">H", data, 13)[0] or ack
        if struct.unpack_from(">H", data, 11)[0] != run:
            raise RuntimeError("a block of another run")
        if decode:
            _ = np.frombuffer(data, ">i2", 110, 33).reshape(22, 5) * (10.0 / 32768.0)
        n += 1
    connection.close()
    return n / (time.monotonic() - start_s)


def _driver_rate(port: int, seconds: float, run: int, *, decode: bool) -> float:
    """Return exchanges per second of the driver: checked bytes, or decoded and scaled blocks."""
    from hdbench.devices.node.access import NodeAccess
    from hdbench.devices.node.blocks import BlockReader
    from hdbench.devices.wire.link import connect

    wire = NodeAccess(connect(parse_address(f"tcp://127.0.0.1:{port}")), deadline_s=1.0)
    limits = {
        "range_v": 10.0, "current_range_a": 10.0, "converter_bits": 16,
        "limit_velocity_rad_s": 400.0, "encoder_counts_per_turn": 4000,
    }  # fmt: skip
    roles = ("torque", "tacho", "current", "reference", "encoder")
    settings = DaqSettings(roles, 1e-3, 2**31, 0.5)
    reader = BlockReader(limits, settings, run=run, where="node")
    start_s, n = time.monotonic(), 0
    while True:
        now_s = time.monotonic()
        if now_s - start_s >= seconds:
            break
        raw = wire.exchange(reader.window, reader.ack)
        if decode:
            reader.take(raw, (now_s, time.monotonic()))
        else:
            reader.ack = (raw[4] << 8 | raw[5]) or reader.ack
        n += 1
        if reader.ack == 0xFFFE:
            reader = BlockReader(limits, dataclasses.replace(settings), run=run, where="node")
    wire.close()
    return n / (time.monotonic() - start_s)


def polled(seconds: float) -> dict[str, object]:
    """Compare the link of polled devices with pymodbus as it comes and with bare sockets."""
    row: dict[str, object] = {}
    for place in PLACES:
        with served(_register_server, place) as port:
            for count in (2, 20, 125):
                row[f"{place}, {count} registers"] = _compare_polled((port, 0, count), seconds / 7)
    with process("-m", "hdbench_cli", "emulate", "--profile", "laumas-tlb4", "--json") as told:
        # its weight, after the 10 ms that the device takes for a reply
        row["emulated device"] = _compare_polled((json.loads(told)["port"], 6, 2), seconds / 7)
    print(json.dumps(row), flush=True)
    return row


def _register_server(port: Any) -> None:
    """Answer every read of registers with zeros."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port.value = listener.getsockname()[1]
        while True:
            connection, _ = listener.accept()
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with connection:
                while request := connection.recv(4096):
                    size = 2 * request[11]
                    head = struct.pack(">HHBBB", 0, 3 + size, 1, 3, size)
                    connection.sendall(request[:2] + head + bytes(size))


def _compare_polled(place: tuple[int, int, int], seconds: float) -> dict[str, object]:
    rates: dict[str, list[tuple[float, float]]] = {"strict": [], "stock": [], "raw": []}
    for _ in range(TURNS):
        for name, reader in (("strict", _strict), ("stock", _stock), ("raw", _raw)):
            with reader(*place) as ask:
                rates[name].append(_rate(ask, seconds / (3 * TURNS)))
    result: dict[str, object] = {}
    for at, what in ((0, "per_s"), (1, "per_cpu_s")):
        ours, stock, raw = ([each[at] for each in rates[name]] for name in rates)
        # what two calls of the system cost, without any Modbus, bounds them all
        result[what] = {
            "stock": compared(ours, stock),
            "raw": compared(ours, raw),
            "raw beside stock": compared(raw, stock),
        }
    return result


def _rate(ask: Callable[[], object], seconds: float) -> tuple[float, float]:
    """Return requests per second, and per second of this thread's processor time."""
    for _ in range(20):
        ask()
    start_s, cpu_s, n = time.monotonic(), time.thread_time(), 0
    while time.monotonic() - start_s < seconds:
        for _ in range(10):
            ask()
        n += 10
    return n / (time.monotonic() - start_s), n / (time.thread_time() - cpu_s)


@contextmanager
def _strict(port: int, start: int, count: int) -> Iterator[Callable[[], object]]:
    from hdbench.devices.modbus.replies import polled_link
    from hdbench.devices.wire.link import read_registers

    link = polled_link(parse_address(f"tcp://127.0.0.1:{port}"))
    request, check = read_registers(start, count)
    yield lambda: link.transact(request, check, time.monotonic() + 1.0)
    link.close()


@contextmanager
def _stock(port: int, start: int, count: int) -> Iterator[Callable[[], object]]:
    from pymodbus.client import ModbusTcpClient

    client = ModbusTcpClient("127.0.0.1", port=port)
    client.connect()
    yield lambda: client.read_holding_registers(start, count=count).registers
    client.close()


@contextmanager
def _raw(port: int, start: int, count: int) -> Iterator[Callable[[], object]]:
    """Send the same bytes and take whatever comes."""
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        request = struct.pack(">HHHBBHH", 1, 0, 6, 1, 3, start, count)
        yield lambda: (connection.sendall(request), connection.recv(4096))


def main() -> int:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--only", choices=["serial", "sustained", "tcp", "polled"])
    asked = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    results: dict[str, object] = {}
    runs = {"serial": serial, "sustained": sustained, "tcp": tcp, "polled": polled}
    for name, run in runs.items():
        if asked.only in (None, name):
            results[name] = run(asked.seconds)
    print(json.dumps(results))
    return 0


if __name__ == "__main__":
    sys.exit(main())
