"""The strict layer against a server that misbehaves."""

import socket
import struct
import time
from collections.abc import Callable
from contextlib import closing, contextmanager, nullcontext
from functools import partial

import pytest
from daqkit import ScriptedLine
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nodekit import adu, node_wire, rogue
from stopwatch import SLACK_S, fails

from hdbench.devices.node.access import NodeAccess
from hdbench.devices.node.registers import FEED, IDENTITY, LIMITS, PARAMETERS, STATUS, register
from hdbench.devices.wire.link import ExceptionReply, FrameError, registers_check
from hdbench.devices.wire.rtu import crc16
from hdbench.devices.wire.tcp import next_reply
from hdbench.errors import DeviceError

SERIAL = (register("serial"),)
GOOD = bytes((3, 16)) + b"S/N 0001" + bytes(8)
COMMAND = (register("command"),)


@contextmanager
def _talking(handler, deadline_s: float):
    """Yield access to a server that misbehaves, and the request frames that it hears."""
    with (
        rogue(handler) as (host, port, frames),
        closing(node_wire(host, port, deadline_s=deadline_s)) as wire,
    ):
        yield wire, frames


def _reply(pdu: bytes) -> Callable[[socket.socket, bytes], None]:
    return lambda connection, request: connection.sendall(adu(request, pdu))


def _hang_up(connection: socket.socket, request: bytes) -> None:
    connection.shutdown(socket.SHUT_RDWR)


def _reset(connection: socket.socket, request: bytes) -> None:
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    connection.close()


def _silent(connection: socket.socket, request: bytes) -> None:
    return None


def _slow(connection: socket.socket, request: bytes, pause_s: float = 0.05) -> None:
    for byte in adu(request, GOOD):
        connection.sendall(bytes((byte,)))
        time.sleep(pause_s)


WRONG_READ_REPLIES = {
    "transaction id": lambda c, r: c.sendall(adu(r, GOOD, tid=(r[1] + 1) % 256)),
    "transaction id 0": lambda c, r: c.sendall(adu(r, GOOD, tid=0)),
    "unit id": lambda c, r: c.sendall(adu(r, GOOD, unit=9)),
    "protocol id": lambda c, r: c.sendall(adu(r, GOOD)[:2] + b"\0\7" + adu(r, GOOD)[4:]),
    "function code 4": _reply(b"\4" + GOOD[1:]),
    "function code 23": _reply(b"\x17" + GOOD[1:]),
    "two registers too many": _reply(bytes((3, 20)) + bytes(20)),
    "one register too few": _reply(bytes((3, 14)) + bytes(14)),
    "odd byte count": _reply(bytes((3, 15)) + bytes(15)),
    "byte count above the data": _reply(bytes((3, 16)) + bytes(10)),
    "byte count below the data": _reply(bytes((3, 10)) + bytes(16)),
    "no byte count": _reply(b"\3"),
    "exception without a code": _reply(b"\x83"),
    "garbage before": lambda c, r: c.sendall(b"\xff\xff\xff" + adu(r, GOOD)),
    "silence": _silent,
    "slow bytes": _slow,
    "FIN": _hang_up,
    "RST": _reset,
}


@pytest.mark.parametrize("fault", WRONG_READ_REPLIES)
def test_a_wrong_reply_to_a_read_is_never_delivered_and_the_deadline_holds(fault, capfd):
    with (
        _talking(WRONG_READ_REPLIES[fault], 0.6) as (wire, frames),
        # 10 % as required, plus what the scheduler may add
        fails(DeviceError, within_s=1.1 * 0.6 + SLACK_S) as caught,
    ):
        wire.read(SERIAL)
    assert "register serial (0x0114)" in caught.value.where
    assert len(frames) == 2, "a read is repeated exactly once"
    assert capfd.readouterr() == ("", ""), "told by the error alone"


WRONG_WRITE_REPLIES = {
    "other value": lambda c, r: c.sendall(adu(r, b"\6" + r[8:10] + b"\0\7")),
    "other address": lambda c, r: c.sendall(adu(r, b"\6\0\1" + r[10:12])),
    "answered as FC3": lambda c, r: c.sendall(adu(r, b"\3\2\0\1")),
    "answered as FC16": lambda c, r: c.sendall(adu(r, b"\x10" + r[8:12])),
    "too short": lambda c, r: c.sendall(adu(r, b"\6" + r[8:10])),
    "silence": _silent,
    "FIN": _hang_up,
    "RST": _reset,
}


@pytest.mark.parametrize("fault", WRONG_WRITE_REPLIES)
def test_a_motion_write_without_its_echo_fails_and_is_sent_once(fault):
    with (
        _talking(WRONG_WRITE_REPLIES[fault], 0.2) as (wire, frames),
        fails(DeviceError, within_s=1.1 * 0.2 + SLACK_S) as caught,
    ):
        wire.write_once(COMMAND, b"\0\1")
    assert isinstance(caught.value.__cause__, FrameError), "no answer, not a refusal"
    assert len(frames) == 1, "never repeated"


@pytest.mark.parametrize("pdu", [b"\x06\x10\x40\0\7", b"\3\2\0\1"])
def test_after_a_wrong_reply_the_connection_is_not_used_again(pdu):
    used = []

    def wrong(connection: socket.socket, request: bytes) -> None:
        used.append(connection.fileno())
        connection.sendall(adu(request, pdu if len(used) == 1 else b"\6" + request[8:12]))

    with _talking(wrong, 0.5) as (wire, _):
        with pytest.raises(DeviceError):
            wire.write_once(COMMAND, b"\0\2")
        wire.write_once(COMMAND, b"\0\2")
    assert len(set(used)) == 2


def test_a_first_byte_does_not_lengthen_the_wait():
    def one_byte(connection: socket.socket, request: bytes) -> None:
        time.sleep(1.2)
        connection.sendall(request[:1])

    with (
        _talking(one_byte, 1.5) as (wire, _),
        # a wait begun anew by the byte would end after 2.7 s
        fails(DeviceError, "in time", within_s=1.1 * 1.5 + SLACK_S),
    ):
        wire.write_once(COMMAND, b"\0\2")


def test_an_fc16_echo_with_another_count_is_refused():
    with (
        _talking(lambda c, r: c.sendall(adu(r, b"\x10" + r[8:10] + b"\0\x63")), 0.2) as (wire, _),
        pytest.raises(DeviceError, match="10 10 00 63; needed: 5 bytes, 10 10 10 00 02"),
    ):
        wire.write_once(PARAMETERS[:1], bytes(4))


@pytest.mark.parametrize(
    ("code", "meaning"), [(1, "illegal function"), (2, "address"), (3, "value"), (4, "failure")]
)
def test_an_exception_names_register_and_meaning_and_is_not_repeated(code, meaning):
    with (
        _talking(lambda c, r: c.sendall(adu(r, bytes((r[7] | 0x80, code)))), 0.5) as (wire, frames),
        pytest.raises(DeviceError, match=f"exception {code} .*{meaning}") as caught,
    ):
        wire.read(SERIAL)
    assert "serial (0x0114)" in caught.value.where
    # the second one asks for the node's own reason
    asked = [struct.unpack(">H", frame[8:10])[0] for frame in frames]
    assert asked == [register("serial").address, register("refusal").address]


def test_a_reply_byte_by_byte_is_put_together():
    with _talking(partial(_slow, pause_s=0.0), 2.0) as (wire, _):
        assert wire.read(SERIAL) == GOOD[2:]


def test_a_stale_reply_before_the_right_one_is_skipped():
    def twice(connection: socket.socket, request: bytes) -> None:
        stale = adu(request, bytes((3, 16)) + b"stale" + bytes(11), tid=40000)
        connection.sendall(stale + adu(request, GOOD))

    with _talking(twice, 1.0) as (wire, frames):
        assert wire.read(SERIAL) == GOOD[2:]
    assert len(frames) == 1


def test_a_late_reply_is_never_taken_for_the_next_read():
    """The first reply comes after its deadline and holds other data than the second."""
    answers = iter((b"late", b"late", b"good", b"good"))

    def late_then_good(connection: socket.socket, request: bytes) -> None:
        text = next(answers)
        if text == b"late":
            time.sleep(0.3)
        connection.sendall(adu(request, bytes((3, 16)) + text + bytes(12)))

    with _talking(late_then_good, 0.2) as (wire, _):
        with pytest.raises(DeviceError, match="in time"):
            wire.read(SERIAL)
        time.sleep(0.3)
        assert wire.read(SERIAL)[:4] == b"good"


def test_nobody_listening_is_a_device_error_at_once():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        host, port = listener.getsockname()
    wire = node_wire(host, port, deadline_s=0.5)
    with pytest.raises(DeviceError, match="Connection refused"):
        wire.read(SERIAL)


@pytest.mark.parametrize("group", [IDENTITY, STATUS, (*FEED, register("state"))])
def test_only_registers_of_the_allow_list_can_be_written(group):
    with _talking(_silent, 0.2) as (wire, frames), pytest.raises(ValueError, match="not writable"):
        wire.write_once(group, bytes(2 * sum(entry.size for entry in group)))
    assert not frames


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    frames=st.lists(
        st.tuples(st.integers(0, 3), st.integers(0, 2), st.binary(min_size=1, max_size=40))
        | st.binary(max_size=9),
        max_size=4,
    ),
    tid=st.integers(0, 3),
    unit=st.integers(0, 2),
)
def test_any_bytes_give_a_whole_reply_of_this_transaction_or_nothing(frames, tid, unit):
    data = b"".join(
        frame
        if isinstance(frame, bytes)
        else struct.pack(">HHHB", frame[0], 0, len(frame[2]) + 1, frame[1]) + frame[2]
        for frame in frames
    )
    try:
        pdu, rest = next_reply(data, tid, unit)
    except FrameError:
        return
    assert data.endswith(rest)
    if pdu is not None:
        header = struct.pack(">HHHB", tid, 0, len(pdu) + 1, unit)
        assert header + pdu in data


@settings(max_examples=300, deadline=None)
@given(pdu=st.binary(min_size=1, max_size=253), count=st.integers(1, 125))
def test_only_an_exact_register_reply_passes(pdu, count):
    exact = len(pdu) == 2 + 2 * count and pdu[0] == 3 and pdu[1] == 2 * count
    with nullcontext() if exact else pytest.raises((FrameError, ExceptionReply)):
        registers_check(3, count)(pdu)


@pytest.mark.parametrize("late_s", [0.0, 0.01, 0.03, 0.15])
def test_a_reply_within_the_deadline_is_delivered_however_late_it_is(late_s):
    """Soon, by one system call; or after the kernel has given up and the fine clock waits."""

    def late(connection, request):
        time.sleep(late_s)
        connection.sendall(adu(request, GOOD))

    with _talking(late, 4.0) as (wire, frames):
        start_s = time.monotonic()
        assert [wire.read(SERIAL) for _ in range(3)] == [GOOD[2:]] * 3
        assert time.monotonic() - start_s >= 3 * late_s
    assert len(frames) == 3


@given(data=st.binary(max_size=300))
@settings(max_examples=200, deadline=None)
def test_the_checksum_of_a_serial_frame_is_that_of_the_specification_bit_by_bit(data):
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    assert crc16(data) == value.to_bytes(2, "little")
    # a frame with its checksum leaves nothing
    assert crc16(data + crc16(data)) == b"\0\0"


@pytest.mark.parametrize(
    "call",
    [lambda wire: wire.read(LIMITS), lambda wire: wire.write_once(COMMAND, b"\0\1")],
    ids=["read", "write"],
)
def test_the_reason_of_a_refusal_is_asked_for_in_what_is_left(call):
    """A deadline is a moment on the clock: nothing that is tried within it begins it anew."""
    line = ScriptedLine(2, 2, takes_s=0.09)
    wire = NodeAccess(line, deadline_s=0.2, clock=line)
    end_s = line.now_s + 0.2 + 1e-9
    with pytest.raises(DeviceError, match="refused"):
        call(wire)
    assert len(line.untils_s) == 2, "the request, and why it was refused"
    assert max(*line.untils_s, line.now_s) <= end_s
