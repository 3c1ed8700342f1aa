"""Links to polled devices: every wire, and replies that are none."""

import json
import socket
import struct
import threading
import time

import pytest
from changing import REPORT
from hypothesis import example, given, settings
from hypothesis import strategies as st
from modbuskit import KNOWN, driving, opened, served, table
from stopwatch import fails

from hdbench.devices.guard.order import as_json, order_of
from hdbench.devices.guard.process.stopping import make_safe, note_identity
from hdbench.devices.guard.session import GuardProcess
from hdbench.devices.modbus.driver import stop_target
from hdbench.devices.modbus.replies import StrictClient, polled_link
from hdbench.devices.wire.address import parse_address
from hdbench.devices.wire.link import ExceptionReply, FrameError, read_registers, write_register
from hdbench.devices.wire.rtu import crc16
from hdbench.errors import DeviceError

WIRES = ("tcp", "udp", "rtu+tcp", "rtu", "ascii")

BENCH = driving()
# what a scheduler adds to a deadline, s
SLACK_S = 0.3
READ, CHECK = read_registers(7, 2)
REPLY = bytes.fromhex("0304 0102 0304".replace(" ", ""))


def stopping(found, **changes):
    """Return the guard's order to stop a device, as its process reads it."""
    daq = BENCH.model_copy(update={"address": found.address, **changes})
    return json.loads(as_json(stop_target(REPORT, daq)))


@pytest.mark.parametrize("wire", WIRES)
def test_a_device_is_read_driven_and_made_safe_on_every_wire(wire):
    with opened(BENCH, wire) as (found, daq):
        assert found.address.startswith(f"{wire}://")
        assert daq.identity().simulated
        # noise is 8 mV, eight of its deviations
        assert daq.snapshot()["torque"] == pytest.approx(found.torque_v(), abs=0.08)
        assert daq.write_output("reference", 1.234) == pytest.approx(1.234)
        assert found.instrument.reference_v == pytest.approx(1.234)
        # sent once, and the same bytes on every wire
        assert [pdu.hex() for pdu in found.written] == ["06003204d2"]
        assert daq.safe_state().confirmed
        assert found.instrument.reference_v == 0.0
        daq.write_output("reference", 2.0)
        # a serial line has one master at a time
        daq.close()
        target = stopping(found)
        note_identity(target)
        assert make_safe(target, alone=True) == ""
        assert found.instrument.reference_v == 0.0


@pytest.mark.parametrize(
    ("rule", "value", "known"),
    [
        ({"equals": 7}, 7, True),
        ({"equals": 7}, 9, False),
        ({"low": 5, "high": 8}, 9, False),
        # the other bits may change while the motor turns
        ({"equals": 0x1200, "mask": 0xFF00}, 0x12AB, True),
        ({"equals": 0x1200, "mask": 0xFF00}, 0x13AB, False),
    ],
)
def test_the_guard_knows_a_device_by_every_rule_and_writes_to_no_other(rule, value, known):
    place = {"address": 3, "type": "u16"}
    identify = table(identify=({**place, "equals": value},)).identify
    with served(BENCH.model_copy(update={"identify": identify})) as found:
        rules = table(identify=(KNOWN, {**place, **rule})).identify[1:]
        target = stopping(found, identify=rules)
        if known:
            note_identity(target)
            assert make_safe(target, alone=True) == ""
            return
        with pytest.raises(FrameError, match="another device"):
            note_identity(target)
        assert "another device" in make_safe(target, alone=True)
        assert found.written == []


@pytest.mark.parametrize("wire", WIRES)
def test_a_device_that_is_silent_ends_a_call_at_its_deadline(wire):
    with opened(BENCH, wire, deadline_s=0.8) as (found, daq):
        daq.identity()
        found.call(lambda: setattr(found.device, "hears", lambda _: False))
        with fails(DeviceError, "no valid reply in time", within_s=0.8 + SLACK_S):
            daq.snapshot()
        found.call(lambda: delattr(found.device, "hears"))
        assert "torque" in daq.snapshot()


@pytest.mark.parametrize("wire", ["tcp", "rtu+tcp"])
def test_a_device_that_hangs_up_is_told_at_once_and_found_again(wire):
    with served(BENCH, wire=wire) as found:
        link = polled_link(parse_address(found.address))
        reply = link.transact(*read_registers(1, 1), time.monotonic() + 2.0)
        assert reply == bytes.fromhex("03021234")
        found.call(found.server.hang_up)
        with fails(FrameError, r"closed|reset", within_s=1.0):
            link.transact(*read_registers(1, 1), time.monotonic() + 5.0)
        assert link.transact(*read_registers(1, 1), time.monotonic() + 2.0) == reply
        link.close()


# -- replies that are none ------------------------------------------------------------------------


def framed(form, pdu, *, number=1, unit=1):
    """Return a reply as it stands on the wire, made without pymodbus."""
    body = bytes((unit,)) + pdu
    if form == "rtu":
        return body + crc16(body)
    if form == "ascii":
        return b":" + (body + bytes((-sum(body) & 0xFF,))).hex().upper().encode() + b"\r\n"
    return struct.pack(">HHH", number, 0, len(body)) + body


def given_pieces(line, until_s):
    if not line:
        raise FrameError("no valid reply in time")
    return line.pop(0)


def client(form, put=lambda line, frame, until_s: None, unit=1):
    return StrictClient(form, unit, put, given_pieces)


def ask(form, *pieces):
    """Return what a client makes of pieces that come one after the other, then nothing."""
    return client(form).ask(list(pieces), READ, CHECK, 0.0)


FORMS = ("socket", "rtu", "ascii")


@pytest.mark.parametrize("form", FORMS)
def test_a_reply_is_taken_whole_or_in_any_pieces(form):
    frame = framed(form, REPLY)
    assert ask(form, frame) == REPLY
    for cut in range(1, len(frame)):
        assert ask(form, frame[:cut], frame[cut:]) == REPLY
    assert ask(form, *(bytes((one,)) for one in frame)) == REPLY


@pytest.mark.parametrize("form", FORMS)
def test_a_refusal_is_told_and_a_wrong_one_is_none(form):
    with pytest.raises(ExceptionReply) as told:
        ask(form, framed(form, b"\x83\x02"))
    assert told.value.code == 2
    with pytest.raises(FrameError):
        ask(form, framed(form, b"\x84\x02"))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    "pdu",
    ["04040102030 4", "0302 0102", "0306 010203040506", "0304 010203", "0305 0102030405", "03", ""],
)
def test_another_function_count_or_length_is_never_delivered(form, pdu):
    with pytest.raises(FrameError):
        ask(form, framed(form, bytes.fromhex(pdu.replace(" ", ""))))


@pytest.mark.parametrize("form", FORMS)
@given(data=st.data())
@settings(max_examples=200, deadline=None)
def test_a_changed_bit_that_a_frame_can_show_is_never_delivered(form, data):
    frame = bytearray(framed(form, REPLY))
    # Modbus TCP has no checksum: the values behind header, function and count can be anything
    last = 9 if form == "socket" else len(frame)
    at = data.draw(st.integers(0, 8 * last - 1))
    frame[at // 8] ^= 1 << at % 8
    # the form of a letter tells nothing
    if form == "ascii" and frame.upper() == framed(form, REPLY):
        assert ask(form, bytes(frame)) == REPLY
        return
    with pytest.raises(FrameError):
        ask(form, bytes(frame))


@pytest.mark.parametrize("form", FORMS)
@given(garbage=st.binary(max_size=300))
@example(garbage=b":+10304")
@example(garbage=bytes(300))
@example(garbage=b"\x01\x08\x00")
@settings(max_examples=200, deadline=None)
def test_any_bytes_end_as_a_fault_of_the_frame(form, garbage):
    with pytest.raises((FrameError, ExceptionReply)):
        ask(form, garbage)


def test_replies_of_other_transactions_and_units_are_passed_over():
    good = framed("socket", REPLY)
    other = bytes.fromhex("0304ffffffff")
    late, foreign = framed("socket", other, number=9), framed("socket", other, unit=7)
    assert ask("socket", late + foreign + good) == REPLY
    assert ask("socket", late[:5], late[5:] + good[:9], good[9:]) == REPLY


def test_what_stands_behind_a_reply_is_read_before_what_comes():
    """Half a duplicate left on a stream must not put the next reply out of step."""
    asking = client("socket").ask
    first, second = framed("socket", REPLY), framed("socket", b"\x03\x04\0\0\0\5", number=2)
    pieces = [first + first[:8], first[8:] + second]
    assert asking(pieces, READ, CHECK, 0.0) == REPLY
    assert asking(pieces, READ, CHECK, 0.0)[-1] == 5
    assert pieces == []


def test_a_request_goes_out_once_and_to_the_byte():
    sent = []
    for form in FORMS:
        asking = client(form, lambda _, frame, __: sent.append(frame), unit=17).ask
        with pytest.raises(FrameError):
            asking([], *write_register(1, 3), 0.0)
    # the second and third example: "MODBUS over Serial Line" V1.02, 2.5.1 and 2.5.2.2
    assert [frame.hex() for frame in sent[:2]] == ["000100000006110600010003", "1106000100039a9b"]
    assert sent[2] == b":110600010003E5\r\n"


def test_a_piece_of_a_datagram_is_no_reply():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
        device.bind(("127.0.0.1", 0))

        def serve():
            request, host = device.recvfrom(512)
            number = int.from_bytes(request[:2], "big")
            good = framed("socket", REPLY, number=number)
            for datagram in (good[:9], good + b"\0", good[9:], good):
                device.sendto(datagram, host)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        link = polled_link(parse_address(f"udp://127.0.0.1:{device.getsockname()[1]}"))
        assert link.transact(READ, CHECK, time.monotonic() + 2.0) == REPLY
        link.close()
        thread.join(5)


def test_the_ascii_form_has_seven_bits_unless_told():
    """MODBUS over Serial Line V1.02, 2.5.2: start, seven data, parity, stop."""
    assert parse_address("ascii:///dev/ttyUSB0?baud=9600").serial.character_s == 10 / 9600
    assert parse_address("ascii:///dev/ttyUSB0?baud=9600&bits=8").serial.data_bits == 8
    assert parse_address("rtu:///dev/ttyUSB0?baud=9600").serial.character_s == 11 / 9600


@pytest.mark.parametrize("wire", WIRES)
def test_the_guard_reaches_a_polled_device_on_every_wire(wire):
    """Its process has the standard library and the libraries of the wire alone."""
    with served(BENCH, wire=wire) as found:
        daq = BENCH.model_copy(update={"address": found.address})
        GuardProcess(order_of(REPORT.model_copy(update={"daq": daq})), 5.0).end()
