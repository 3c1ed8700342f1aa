"""The guard stops the motor when the session dies, freezes or leaves without a word."""

import json
import math
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from contextlib import closing, contextmanager
from itertools import islice
from pathlib import Path

import pytest
from changing import REPORT, with_keys
from forked import ended
from nodekit import PROFILE, adu, driver, host, proxy, realtime_emulator, served, until
from serial import Serial
from served import WAVE, begin, given
from stopwatch import fails

from hdbench.devices.bench import AcquisitionSettings
from hdbench.devices.guard import session as launching
from hdbench.devices.guard.order import Look, as_json, order_of
from hdbench.devices.guard.process import stopping, watching
from hdbench.devices.guard.process.stopping import FAULTS, Wire, make_safe, note_identity, wrong
from hdbench.devices.guard.session import GuardProcess, guard_silence_s
from hdbench.devices.host.bench import HostedBench
from hdbench.devices.wire.link import FrameError, read_registers, write_register
from hdbench.devices.wire.rtu import crc16
from hdbench.errors import BusyError, DeviceError
from hdbench.profile import load_profile
from hdbench.system.lines import open_port, terminal_pair


@pytest.fixture
def patient_guard(monkeypatch):
    """Give a device that answers the time that a busy computer takes from it."""
    monkeypatch.setattr(stopping, "REPLY_S", 1.0)
    monkeypatch.setattr(stopping, "SESSION_S", 10.0)


def told(order_or_target):
    """Return it as the guard's process reads it."""
    return json.loads(as_json(order_or_target))


def profile_at(host, port):
    return with_keys(PROFILE, daq={"address": f"tcp://{host}:{port}"})


def target_of(profile):
    """Return what the guard of a node does, as its process reads it."""
    (target,) = order_of(profile).targets
    return told(target)


def guarding(bench, start_guard):
    """Return the same device with a guard."""
    return HostedBench(bench.daq, bench.settings, start_guard=start_guard)


@contextmanager
def guarded(node, tmp_path, silence_s=0.3):
    order = order_of(profile_at(node.host, node.port))
    log = tmp_path / "guard.jsonl"
    with driver(node.host, node.port, watchdog_s=2.0) as bench:
        bench.claim()
        found = guarding(bench, lambda: GuardProcess(order, silence_s, log=log))
        try:
            yield found
        finally:
            found.safe_state()
            found.close()


def turn(bench):
    begin(bench, AcquisitionSettings(1e-3, 1_000_000, WAVE))
    for _ in islice(given(bench), 5):
        pass


@contextmanager
def turning(tmp_path, silence_s=0.3):
    """Yield a node in real time and a guarded bench whose motor turns."""
    with served(pace="realtime") as node, guarded(node, tmp_path, silence_s) as bench:
        turn(bench)
        yield node, bench


def read_until(bench, until_s):
    while time.monotonic() < until_s:
        bench.read_block()


def motor(node):
    return node.core.machine.bench.reference_v


def test_a_session_that_says_nothing_has_its_motor_stopped_and_is_told(tmp_path):
    with turning(tmp_path) as (node, bench):
        assert motor(node) == pytest.approx(1.0)
        start_s = time.monotonic()
        # the silence it was given, and its own round trip; the watchdog has 2 s
        assert until(lambda: motor(node) == 0.0, 2.0) < 1.5
        assert time.monotonic() - start_s > 0.2
        assert node.core.machine.trips == 0
        log = tmp_path / "guard.jsonl"
        until(lambda: log.exists() and log.read_text().endswith("\n"), 2.0)
        with pytest.raises(DeviceError, match="no sign of life"):
            read_until(bench, start_s + 5.0)
    event = json.loads(log.read_text())
    assert event["confirmed"] is True
    assert event["problem"] is None


def test_a_session_that_gives_signs_of_life_is_left_alone(tmp_path):
    with turning(tmp_path) as (node, bench):
        read_until(bench, time.monotonic() + 1.0)
        assert motor(node) == pytest.approx(1.0)
        pid = bench.guard.pid
        assert bench.safe_state().confirmed
        assert bench.guard is None
    assert not Path(f"/proc/{pid}").exists()
    assert not (tmp_path / "guard.jsonl").exists()


def test_a_bench_that_is_closed_without_the_safe_state_is_made_safe(tmp_path):
    with turning(tmp_path, 1.0) as (node, bench):
        bench.close()
        assert motor(node) == 0.0
        assert node.core.machine.trips == 0


def test_a_session_whose_guard_dies_is_told_at_its_next_block(tmp_path):
    with turning(tmp_path) as (_, bench):
        os.kill(bench.guard.pid, signal.SIGKILL)
        with fails(DeviceError, "guard process", within_s=5.0):
            read_until(bench, time.monotonic() + 20.0)


def test_what_ends_a_session_does_not_end_the_guard(tmp_path):
    with turning(tmp_path, 2.0) as (_, bench):
        for signum in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(bench.guard.pid, signum)
        time.sleep(0.2)
        bench.guard.watch("closely")
        assert os.getsid(bench.guard.pid) != os.getsid(0)


def test_motion_without_a_second_connection_is_refused(tmp_path):
    with served() as node, driver(node.host, node.port) as inner:
        inner.claim()
        nowhere = order_of(profile_at("127.0.0.1", 1))
        bench = guarding(inner, lambda: GuardProcess(nowhere, 1.0))
        with pytest.raises(DeviceError, match="does not reach the device"):
            bench.configure(AcquisitionSettings(1e-3, 1000, WAVE))
        assert motor(node) == 0.0
        bench.close()


# the unit and the PDU that come in place of those of a reply
NO_REPLIES = {
    "unit": lambda pdu: (77, pdu),
    "unit and function": lambda pdu: (77, b"\3\2\0\0"),
    "function of a write": lambda pdu: (1, b"\3\2\0\0" if pdu[0] == 6 else pdu),
    "value of a write": lambda pdu: (1, pdu[:-1] + b"\x55" if pdu[0] == 6 else pdu),
    "longer": lambda pdu: (1, pdu + b"\0\0"),
    "byte count": lambda pdu: (1, pdu[:1] + b"\2" + pdu[2:] if pdu[0] == 3 else pdu),
}


@pytest.mark.parametrize("kind", NO_REPLIES)
def test_the_guard_takes_no_other_reply_for_its_own(kind, request):
    def mangle(_number, reply):
        unit, pdu = NO_REPLIES[kind](reply[7:])
        return adu(reply, pdu, unit=unit)

    with served(pace="realtime") as node:
        with proxy(node.host, node.port, mangle) as (host, port, frames):
            assert make_safe(target_of(profile_at(host, port)), alone=False) != ""
        assert frames
        request.getfixturevalue("patient_guard")
        with proxy(node.host, node.port, lambda _, reply: reply) as (host, port, _):
            assert make_safe(target_of(profile_at(host, port)), alone=False) == ""


def test_a_guard_whose_words_nobody_reads_goes_on_trying():
    program = launching._PROGRAM.replace(
        "import main; main()",
        "import say\nfor _ in range(2000): say('w' * 200)\nprint('done', flush=True)",
    )
    words = [sys.executable, "-I", "-S", "-c", program]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as talking:
        try:
            assert select.select([talking.stdout], [], [], 20.0)[0], "held up by a full pipe"
            assert talking.stdout.read(4) == b"done"
        finally:
            talking.kill()


def test_a_bug_in_the_guard_does_not_end_its_trying(monkeypatch):
    tries = []

    def fails_once(order, *, alone):
        tries.append(alone)
        if len(tries) == 1:
            raise KeyError("bug")
        return ""

    monkeypatch.setattr(watching, "stop_motor", fails_once)
    near, far = socket.socketpair()
    with near, far:
        guard = watching.Watcher(near, {"targets": [], "try_s": 5.0, "log": None, "emulator": None})
        guard.fire("test")
        assert far.recv(100).startswith(b"F")
    assert len(tries) == 2


def test_an_acquisition_without_motion_has_no_guard(tmp_path):
    with served() as node, guarded(node, tmp_path) as bench:
        begin(bench, AcquisitionSettings(1e-3, 1000, None))
        assert bench.guard is None


def events_of(record):
    """Return what a motor did; its last line may be half written."""
    return [json.loads(line) for line in record.read_text().splitlines() if line.endswith("}")]


@pytest.mark.parametrize("signum", [signal.SIGKILL, signal.SIGSTOP])
def test_on_a_serial_line_the_guard_takes_over_from_a_dead_or_frozen_session(tmp_path, signum):
    record = tmp_path / "motor.jsonl"
    with (
        realtime_emulator(REPORT, record=record, wire="rtu") as found,
        host(str(found["address"]), period_s=2e-3) as (process, _),
    ):
        process.send_signal(signum)
        gone_s = time.monotonic()
        until(lambda: events_of(record)[-1]["reference_v"] == 0.0, 3.0)
    zero = next(e for e in events_of(record) if e["event"] in ("stopped", "tripped"))
    # silence of 0.45 s at most, a quiet line, and what a busy computer adds
    assert zero["monotonic_s"] - gone_s < 5.0
    if signum == signal.SIGKILL:
        assert zero["event"] == "stopped", "the guard was there before the watchdog"


def _line(path):
    return target_of(with_keys(PROFILE, daq={"address": f"rtu://{path}?baud=115200"}))["place"]


READ, WRITE = (
    told(Look(asked))["request"] for asked in (read_registers(0, 1), write_register(1, 0))
)


def test_a_serial_line_that_is_gone_does_not_hold_the_guard_up():
    near, far = os.openpty()
    # four tenths of a second each, and the scheduler
    with closing(Wire(_line(os.ttyname(far)), alone=False)) as wire:
        with fails(FrameError, "no valid reply", within_s=2.5):
            wire.transact(READ)
        os.close(near)
        os.close(far)
        with fails(FAULTS, within_s=2.5):
            wire.transact(READ)


@pytest.fixture
def line():
    """Yield the other end of a serial line, and the path of this one."""
    near, far, path = terminal_pair(blocking=True)
    yield near, path
    os.close(near)
    os.close(far)


def test_a_serial_line_that_another_program_has_taken_over_is_left_in_peace(line):
    near, path = line
    target = {
        "place": _line(path), "identity": [], "acts": [WRITE], "looks": [], "finals": [],
        "final_looks": [], "brake_s": 0.0,
    }  # fmt: skip
    with Serial(path, timeout=0, exclusive=True):
        # the session is gone, and somebody has the port
        assert "another program" in make_safe(target, alone=True)
        assert not select.select([near], [], [], 0.0)[0], "nothing was written"
        # the session is frozen, and has the port still
        assert "no valid reply" in make_safe(target, alone=False)
        frame = b"\1\6\0\1\0\0"
        assert os.read(near, 100) == frame + crc16(frame)
    assert "no valid reply" in make_safe(target, alone=True)


def test_a_guard_whose_session_is_dead_has_the_line_for_itself_while_it_works(line):
    _, path = line
    with closing(Wire(_line(path), alone=True)) as wire:
        # nobody answers, and the port stays open
        with pytest.raises(FrameError, match="no valid reply"):
            wire.transact(READ)
        with pytest.raises(BusyError):
            open_port(path, path, baud_bd=115200)
    open_port(path, path, baud_bd=115200).close()


@pytest.mark.usefixtures("patient_guard")
def test_on_a_serial_line_the_guard_knows_who_answered_before_the_motion():
    with realtime_emulator(REPORT, wire="rtu") as found:
        ordered = target_of(with_keys(PROFILE, daq={"address": found["address"]}))
        note_identity(ordered)
        assert make_safe(ordered, alone=True) == ""
        ordered["identity"][0]["known"] = "03" + "00" * 20
        assert "another device" in make_safe(ordered, alone=True)


def test_the_guard_starts_with_the_standard_library_and_the_wire_alone():
    loads = launching._PROGRAM.replace(
        "main()", "import serial, hdbench.devices.wire.rtu, hdbench.devices.wire.tcp, sys; "
        "print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    )  # fmt: skip
    done = ended([sys.executable, "-I", "-S", "-c", loads])
    assert done.returncode == 0, done.stderr
    names = set(done.stdout.split())
    assert {"json", "hdbench", "process"} <= names
    assert names - sys.stdlib_module_names == {"__main__", "hdbench", "process", "serial"}


@pytest.mark.parametrize(
    ("raw", "check", "safe"),
    [
        (struct.pack(">f", 0.2), {"form": ">f", "low": -0.5, "high": 0.5}, True),
        (struct.pack(">f", -0.6), {"form": ">f", "low": -0.5, "high": 0.5}, False),
        (struct.pack(">f", math.nan), {"form": ">f", "low": -0.5, "high": 0.5}, False),
        (struct.pack(">H", 0b1010), {"form": ">H", "low": 0, "high": 0, "mask": 0b0101}, True),
        (struct.pack(">H", 0b1010), {"form": ">H", "low": 0, "high": 0, "mask": 0b1000}, False),
        # 1.5 with the low word first
        (struct.pack(">f", 1.5)[2:] + struct.pack(">f", 1.5)[:2],
         {"form": ">f", "low": 1.5, "high": 1.5, "order": [2, 3, 0, 1]}, True),
        (b"\0\0", {"form": ">f", "low": -1.0, "high": 1.0}, False),
    ],
)  # fmt: skip
def test_what_is_read_back_is_judged_by_its_value(raw, check, safe):
    full = {"name": "value", "at": 2, "mask": 0, "order": [], **check}
    assert (wrong(b"\x03\x04" + raw, full) == "") is safe


@pytest.mark.parametrize(
    ("watchdog_s", "deadline_s", "silence_s"),
    [(0.5, 0.25, 0.45), (2.0, 0.25, 0.5), (2.0, 1.5, 1.8), (5.0, 0.1, 0.5)],
)
def test_the_silence_is_shorter_than_the_watchdog_and_longer_than_a_call(
    watchdog_s, deadline_s, silence_s
):
    assert guard_silence_s(watchdog_s, deadline_s) == pytest.approx(silence_s)


@pytest.mark.parametrize("name", ["cim-tr-97-06", "labjack-t7", "di-2108-ek9000"])
def test_every_bench_that_moves_has_bytes_for_its_guard(name):
    data = load_profile(name).data
    update = {"address": "tcp://127.0.0.1:502"}
    if hasattr(data.daq, "outputs"):
        update = {"outputs": data.daq.outputs.model_copy(update=update)}
    order = order_of(with_keys(data, daq=update))
    assert order.command == ()
    (target,) = order.targets
    assert target.acts
    assert target.looks


def test_a_driver_without_known_bytes_is_made_safe_through_itself(tmp_path):
    order = order_of(load_profile("seneca-z-sg").data)
    assert order.targets == ()
    assert order.command
    with turning(tmp_path) as (node, _):
        there = profile_at(node.host, node.port).model_dump_json(exclude_none=True)
        done = ended(order.command, input=there)
        assert done.returncode == 0, done.stdout + done.stderr
        assert motor(node) == 0.0
