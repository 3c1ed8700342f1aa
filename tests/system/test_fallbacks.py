"""Fallbacks for calls that the system does not have do the same as the calls."""

import errno
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import types

import pytest
from changing import with_keys
from nodekit import realtime_emulator, until
from serial import Serial
from served import WAVE, sampled

from hdbench.devices import AcquisitionSettings, open_bench
from hdbench.devices.opening import _at
from hdbench.profile import load_profile
from hdbench.system import files, keyboard, lines, processes, sockets


@pytest.fixture
def console(monkeypatch):
    """Stand for the console of Windows: `typed` holds what is pressed."""
    module = types.ModuleType("msvcrt")
    module.typed = []
    module.kbhit = lambda: bool(module.typed)
    module.getwch = lambda: module.typed.pop(0)
    monkeypatch.setitem(sys.modules, "msvcrt", module)
    monkeypatch.setitem(sys.modules, "termios", None)
    monkeypatch.setattr(os, "isatty", lambda _: True)
    # other tests may have left a handler of a run
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield module
    signal.signal(signal.SIGINT, before)


def test_single_keys_come_from_the_console_of_windows(console):
    keys = keyboard.keyboard(0)
    assert keys.take_single()
    assert not keys.ready(0.0)
    console.typed += ["r", "\xe0", "H", "ü"]
    assert keys.ready(0.0)
    assert [keys.read() for _ in range(3)] == [b"r", b"\x1b", "ü".encode()]


def test_ctrl_c_at_the_console_of_windows_is_a_signal(console):
    console.typed += ["\x03"]
    with pytest.raises(KeyboardInterrupt):
        keyboard.keyboard(0).read()


def test_lines_come_from_a_pipe_that_cannot_be_waited_for(monkeypatch):
    monkeypatch.setitem(sys.modules, "termios", None)
    near, far = os.pipe()
    keys = keyboard.keyboard(near)
    assert not keys.take_single()
    assert not keys.ready(0.05)
    os.write(far, b"ok\n")
    assert keys.ready(5.0)
    assert keys.read() == b"ok\n"
    os.close(far)
    assert keys.read() == b""
    os.close(near)


def test_a_file_is_locked_by_a_byte_behind_its_content(tmp_path, monkeypatch):
    """As `msvcrt.locking` does: from the place of the descriptor, others are refused."""
    module = types.ModuleType("msvcrt")
    module.LK_NBLCK = 2
    held = {}

    def locking(descriptor, mode, count):
        assert (mode, count) == (2, 1)
        at = os.lseek(descriptor, 0, os.SEEK_CUR)
        assert at >= 1 << 30
        if held.setdefault(at, descriptor) != descriptor:
            raise OSError(errno.EACCES, "Permission denied")

    module.locking = locking
    monkeypatch.setitem(sys.modules, "msvcrt", module)
    monkeypatch.setitem(sys.modules, "fcntl", None)
    path = tmp_path / "lock"
    path.write_bytes(b"content")
    first, second = (os.open(path, os.O_RDWR) for _ in range(2))
    try:
        assert files.lock_file(first) is True
        assert files.lock_file(second) is False
        assert os.read(first, 10) == b"content"
    finally:
        os.close(first)
        os.close(second)


def test_a_process_is_told_from_another_without_proc(monkeypatch):
    monkeypatch.setattr(processes, "Path", lambda _: types.SimpleNamespace(read_text=_missing))
    mine = processes.process_mark(os.getpid())
    assert mine is not None
    assert mine == processes.process_mark(os.getpid())
    time.sleep(0.02)
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        assert processes.process_mark(other.pid) not in (None, mine)
        assert processes.process_exists(other.pid)
    assert processes.process_mark(other.pid) is None
    assert not processes.process_exists(other.pid)


def _missing(**_):
    raise FileNotFoundError


@pytest.mark.parametrize("hide", [True, False])
def test_a_signal_reaches_the_main_thread_from_any_other(hide, monkeypatch):
    if hide:
        monkeypatch.delattr(signal, "pthread_kill")
    seen = []
    before = signal.signal(signal.SIGTERM, lambda *_: seen.append(threading.current_thread()))
    try:
        other = threading.Thread(target=processes.signal_self, args=(signal.SIGTERM,))
        other.start()
        other.join()
        until(lambda: seen, 60.0)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert seen == [threading.main_thread()]


@pytest.mark.parametrize("poll", [True, False])
def test_a_socket_keeps_its_deadline(poll, monkeypatch):
    if not poll:
        monkeypatch.setattr(sockets, "_poll", lambda: None)
    near, far = socket.socketpair()
    with near, far:
        timed = sockets.TimedSocket(near)
        timed.send(b"request", time.monotonic() + 60.0)
        assert far.recv(100) == b"request"
        far.send(b"reply")
        assert timed.receive(100, time.monotonic() + 60.0) == b"reply"
        until_s = time.monotonic() + 0.1
        with pytest.raises(TimeoutError):
            timed.receive(100, until_s)
        # the system's grain of a wait, s
        assert time.monotonic() > until_s - 0.01
        with pytest.raises(TimeoutError):
            timed.send(bytes(10_000_000), time.monotonic() + 0.1)


@pytest.fixture
def polled(monkeypatch):
    monkeypatch.setattr(lines, "port_io", lines._PolledIo)
    monkeypatch.setattr("hdbench.drivers.dataq.port.port_io", lines._PolledIo)


def test_a_serial_node_moves_and_stops_by_pyserial_alone(polled):
    data = load_profile("node-rtu").data
    # a busy machine is no fault of the line
    data = with_keys(data, daq={"deadline_s": 1.0, "watchdog_s": 2.0})
    with realtime_emulator(data, wire="rtu") as found, open_bench(_at(data, found)) as bench:
        got = sampled(bench, AcquisitionSettings(data.daq.sample_period_s, 400, WAVE))
        safe = bench.safe_state()
    assert (len(got.torque_v), got.lost) == (400, 0)
    assert safe.confirmed, safe.detail


def test_a_port_that_is_gone_is_told_by_pyserial_alone():
    near, far, path = lines.terminal_pair()
    port = Serial(path, timeout=0)
    io = lines._PolledIo(port)
    assert not io.readable(0.0)
    os.write(near, b"abc")
    assert io.readable(1.0)
    assert io.read(2) == b"ab"
    assert io.write(b"xyz") == 3
    os.close(far)
    os.close(near)
    assert io.is_gone()
    port.close()
