"""The node on a serial line: the same samples, nothing stale, and the wire's pace."""

import os
import sys
import threading
import time
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from faults import replies
from faults.paced import paced_line
from hypothesis import given, settings
from hypothesis import strategies as st
from nodekit import host
from pymodbus.client import ModbusSerialClient
from served import acquired, gaps, values
from stopwatch import SLACK_S, fails

from hdbench.devices import lock, stop_bench
from hdbench.devices.daq import DaqSettings
from hdbench.devices.node.driver import open_node
from hdbench.devices.wire.address import SerialSettings, parse_address
from hdbench.devices.wire.link import (
    FrameError,
    StaleReply,
    connect,
    read_registers,
    registers_check,
)
from hdbench.devices.wire.rtu import RtuLink, crc16, reply_size
from hdbench.errors import BusyError
from hdbench.system import lines

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")


def _driver(address):
    """Open a driver at an address and close it again."""
    table = replies.PROFILE.daq.model_copy(update={"address": address, "deadline_s": 1.0})
    return closing(open_node(replies.PROFILE, table))


def _sampled(address, roles, n_samples):
    """Return the blocks of an acquisition at 1 kHz, read until it is over."""
    with _driver(address) as daq:
        daq.claim()
        return acquired(daq, DaqSettings(roles, 1e-3, n_samples, 2.0))


def test_every_sample_arrives_once():
    with replies.served("rtu") as address:
        blocks = _sampled(address, replies.ROLES, 20_000)
    assert gaps(blocks, 20_000) == 0
    assert sum(map(replies.wrong_samples, blocks)) == 0


@pytest.mark.parametrize(
    "roles", [("torque",), ("encoder", "torque", "tacho"), ("tacho", "current")]
)
def test_channels_come_in_the_order_asked_for(roles):
    with replies.served("rtu") as address:
        blocks = _sampled(address, roles, 500)
    expected = dict(zip(replies.ROLES, replies.codes_of(np.arange(500)), strict=True))
    scale = {"encoder": 1.0, "current": replies.PROFILE.servo.max_current_a / 32768}
    for column, role in zip(values(blocks).T, roles, strict=True):
        volts = scale.get(role, replies.PROFILE.daq.range_v / 32768)
        np.testing.assert_array_equal(column, expected[role] * volts)


def test_another_modbus_client_reads_the_node():
    with replies.served("rtu") as address:
        port = address.removeprefix("rtu://")
        with ModbusSerialClient(port, baudrate=115200, timeout=2, retries=0) as client:
            reply = client.read_holding_registers(0x0100, count=3)
            assert reply.registers == [0x0011, 0x2233, 2]
            refused = client.write_register(0x0100, 1)
            assert (refused.isError(), refused.exception_code) == (True, 2)


def test_a_second_host_finds_the_line_taken():
    with replies.served("rtu") as address, _driver(address) as second:
        with _driver(address) as first:
            first.identity()
            with pytest.raises(BusyError, match="serial port"):
                second.identity()
        assert second.identity().simulated


def test_stop_ends_the_run_that_has_the_line_and_then_confirms():
    """A serial line has one master: the run is asked first, the line is free then."""
    with replies.served("rtu") as address:
        with host(f"{address}?baud=921600", amplitude_v=2.0) as (run, _):
            assert lock._holder_in(lock._held(address)).pid == run.pid
            assert stop_bench(replies.PROFILE, address=address).confirmed
            assert run.wait(60) != 0
        assert lock._held(address) is None


@pytest.mark.parametrize("wire", ["tcp", "rtu"])
@pytest.mark.parametrize("kind", ["wrong", "stale", "duplicate", "reordered", "mutated"])
def test_no_wrong_sample_comes_through(wire, kind):
    deadline_s = {"tcp": 0.3, "rtu": 1.5}[wire]
    outcome = replies.campaign(wire, kind, 5, deadline_s=deadline_s)
    assert outcome.faults >= 5
    assert outcome.delivered > 0
    assert (outcome.wrong, outcome.lost) == (0, 0)


# -- the link by itself ---------------------------------------------------------------------------


@contextmanager
def _slave(answer):
    """Yield a terminal whose other end answers as a function says, and what is asked of it."""
    near, far, path = lines.terminal_pair(blocking=True)
    ended, requests = threading.Event(), []
    # its own, whatever a test lets the link read
    read = os.read

    def serve():
        waiting = b""
        while not ended.is_set():
            waiting += read(near, 512)
            # every request here is a read: eight characters
            if len(waiting) >= 8 and not ended.is_set():
                requests.append(waiting)
                answer(waiting, partial(os.write, near))
                waiting = b""

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield path, requests
    finally:
        ended.set()
        os.write(far, b"end")
        thread.join(5)
        os.close(near)
        os.close(far)


def _reply(request, *, fill):
    """Answer a read with registers of one value."""
    count = int.from_bytes(request[4:6], "big")
    body = request[:2] + bytes((2 * count,)) + bytes((0, fill)) * count
    return body + crc16(body)


def _answer(request, write):
    write(_reply(request, fill=1))


def _probe(number):
    return read_registers(0x0100, 3 + 2 * (number % 5))


@contextmanager
def _linked(answer=_answer, probe=None, line="baud=115200", check=None):
    """Yield a path, what is asked there, and a function that reads two registers within a time."""
    pdu, own_check = read_registers(7, 2)
    with _slave(answer) as (path, requests):
        link = RtuLink(parse_address(f"rtu://{path}?{line}"), 1, probe)

        def ask(within_s=1.0):
            return link.transact(pdu, check or own_check, time.monotonic() + within_s)

        with closing(link):
            yield path, requests, ask


_fails = partial(fails, FrameError)


def test_a_late_reply_is_never_taken_for_the_next_read():
    """Same function, same count, good checksum: only the quiet line and the probe tell."""
    fills = iter(range(1, 100))
    late = []

    def answer(request, write):
        fill = next(fills)
        reply = _reply(request, fill=fill)
        # probe, then the first question: its answer comes after its deadline
        if fill == 2:
            late.append(threading.Timer(0.15, write, (reply,)))
            late[0].start()
        else:
            write(reply)

    with _linked(answer, _probe) as (_, requests, ask):
        with pytest.raises(FrameError, match="in time"):
            ask(0.12)
        reply = ask()
        late[0].join()
    # the answer to the last request of all
    assert reply[2:] == bytes((0, len(requests))) * 2


def test_bytes_that_stand_on_the_line_before_a_request_are_thrown_away():
    def answer(request, write):
        write(_reply(request, fill=3) + b"left over")

    with _linked(answer) as (*_, ask):
        assert [ask()[2:] for _ in range(3)] == [b"\0\3\0\3"] * 3


def test_a_reply_to_another_question_is_waited_past():
    def answer(request, write):
        write(_reply(request, fill=1))
        write(_reply(request, fill=2))

    def check(pdu):
        registers_check(3, 2)(pdu)
        if pdu[-1] == 1:
            raise StaleReply

    with _linked(answer, check=check) as (*_, ask):
        assert ask()[-1] == 2


@pytest.mark.parametrize(
    "spoil",
    [
        lambda r: r[:-1] + bytes((r[-1] ^ 1,)),
        lambda r: r[:-3],
        lambda r: b"\x02" + r[1:],
        lambda r: bytes((9,)) + r,
        lambda r: r[:1] + b"\x63" + r[2:],
        lambda r: b"",
    ],
    ids=["checksum", "truncated", "unit", "garbage before", "function", "silence"],
)
def test_a_wrong_reply_ends_in_time_and_is_never_delivered(spoil):
    with (
        _linked(lambda request, write: write(spoil(_reply(request, fill=1)))) as (*_, ask),
        _fails(within_s=0.22 + SLACK_S),
    ):
        ask(0.2)


def test_a_line_that_is_never_quiet_holds_no_call_beyond_its_deadline():
    ended = threading.Event()

    def babble(request, write):
        while not ended.wait(0.002):
            write(b"\x55" * 8)

    with _linked(babble, _probe) as (path, _, ask):
        # something to begin with: the other end babbles after its first request
        other = os.open(path, os.O_RDWR | os.O_NOCTTY)
        os.write(other, b"12345678")
        os.close(other)
        time.sleep(0.05)
        for _ in range(2):
            with _fails(r"quiet|silent|never asked", within_s=0.22 + SLACK_S):
                ask(0.2)
        ended.set()


class _Repeater:
    """A line on which whole frames to another question come for 3 s, without a pause."""

    def __init__(self):
        self._until_s = 0.0
        self._frame = _reply(b"\1\3\0\7\0\2", fill=1)

    def readable(self, wait_s):
        return time.monotonic() < self._until_s

    def read(self, size):
        return self._frame

    def write(self, data):
        self._until_s = time.monotonic() + 3.0
        return len(data)


def test_replies_of_before_that_never_end_hold_no_call_beyond_its_deadline():
    def check(pdu):
        raise StaleReply

    link = RtuLink(parse_address("rtu:///dev/none?baud=115200"), 1)
    link._io = _Repeater()
    with _fails("in time", within_s=0.22 + SLACK_S):
        link.transact(read_registers(7, 2)[0], check, time.monotonic() + 0.2)


def test_a_line_that_somebody_else_reads_is_not_taken_for_unplugged(monkeypatch):
    with _linked() as (*_, ask):
        ask()
        # characters have come each time, but another program has taken them
        monkeypatch.setattr(os, "read", lambda *_: b"")
        with _fails("another program reads from this port", within_s=0.55 + SLACK_S):
            ask(0.5)
        monkeypatch.undo()
        assert ask()[2:] == b"\0\1\0\1"


def test_a_port_that_is_pulled_is_told_at_once():
    master, terminal = os.openpty()
    link = RtuLink(parse_address(f"rtu://{os.ttyname(terminal)}?baud=115200"), 1)
    ask = partial(link.transact, *read_registers(7, 2))
    with pytest.raises(FrameError, match="in time"):
        ask(time.monotonic() + 0.1)
    puller = threading.Timer(0.1, lambda: [os.close(end) for end in (terminal, master)])
    puller.start()
    with _fails(r"unplugged|failed", within_s=1.0):
        ask(time.monotonic() + 5.0)
    puller.join()
    link.close()


def test_a_long_silence_between_frames_holds_no_call_beyond_its_deadline():
    with _linked(line="baud=9600&gap_us=900000") as (*_, ask):
        ask(2.0)
        with _fails("silent", within_s=0.22 + SLACK_S):
            ask(0.2)


@pytest.mark.parametrize(("baud", "held"), [(921600, True), (115200, False)])
def test_a_fast_line_keeps_the_processor_awake_while_it_is_open(baud, held, tmp_path, monkeypatch):
    wishes = tmp_path / "cpu_dma_latency"
    wishes.touch()
    monkeypatch.setattr(lines, "_WISHES", str(wishes))

    def holders():
        return [p for p in Path("/proc/self/fd").iterdir() if os.path.realpath(p) == str(wishes)]

    with _linked(line=f"baud={baud}") as (*_, ask):
        ask(2.0)
        assert len(holders()) == held
    assert holders() == []
    # a 32-bit number of microseconds
    assert wishes.read_bytes() == (bytes(4) if held else b"")


def test_a_line_opens_where_nobody_may_keep_the_processor_awake(tmp_path, monkeypatch):
    monkeypatch.setattr(lines, "_WISHES", str(tmp_path / "missing"))
    assert lines.hold_wakeup() is None
    lines.release_wakeup(None)


def test_the_silence_between_frames_is_kept():
    # 11 bits a character: start, eight, parity, stop
    assert SerialSettings(baud_bd=9600).silence_s == pytest.approx(3.5 * 11 / 9600)
    with _linked(line="baud=9600&gap_us=30000") as (*_, ask):
        ask()
        start_s = time.monotonic()
        for _ in range(4):
            ask()
    assert time.monotonic() - start_s >= 4 * 0.03


@given(data=st.binary(max_size=300))
@settings(max_examples=300, deadline=None)
def test_any_bytes_have_a_length_or_are_no_reply(data):
    try:
        size = reply_size(data)
    except FrameError:
        assert len(data) >= 2
        return
    assert size is None or 5 <= size <= 260


# -- the wire's pace ------------------------------------------------------------------------------


def test_the_paced_line_takes_the_time_of_its_characters_and_silences():
    line = SerialSettings(baud_bd=19200)
    sent, received = 8, 5 + 2 * 50
    with _slave(_answer) as (device, _), paced_line(device, line) as path:
        # the slave's own terminal is the device's side; it answers at once
        link = connect(parse_address(f"rtu://{path}", line))
        pdu, check = read_registers(7, 50)
        link.transact(pdu, check, time.monotonic() + 2.0)
        took_s = []
        for _ in range(4):
            start_s = time.monotonic()
            link.transact(pdu, check, time.monotonic() + 2.0)
            took_s.append(time.monotonic() - start_s)
        link.close()
    # one silence is between two exchanges, where the last one's ended before the clock was read
    shortest_s = line.exchange_s(sent, received) - line.silence_s
    assert min(took_s) >= 0.98 * shortest_s
    assert min(took_s) < shortest_s + line.silence_s + 0.03
