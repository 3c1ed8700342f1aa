"""The protocol page says what the code does, byte for byte."""

import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from daqkit import Clock
from hypothesis import given, settings
from hypothesis import strategies as st
from nodekit import PROFILE, TinyBench

from hdbench.devices.emulator.machine import BlockHeader, encode_block, encode_scans, seal_block
from hdbench.devices.emulator.node import build_core
from hdbench.devices.node.blocks import block_fault
from hdbench.devices.node.registers import (
    MAP,
    PARAMETERS,
    PROGRAM,
    Refusal,
    State,
    block_registers,
    register,
    register_at,
)
from hdbench.devices.registers import decode_group, encode_group

PAGE = (Path(__file__).parents[2] / "docs" / "node-protocol.md").read_text(encoding="utf-8")


def test_the_table_of_the_page_is_the_map_of_the_code():
    pattern = r"^\| (0x[0-9A-F]{4})(?:-(0x[0-9A-F]{4}))? \| `(\w+)` \| (\w+) \| (r|rw) \| (.+) \|$"
    page = [
        (name, int(first, 16), int(last or first, 16), kind, access, meaning)
        for first, last, name, kind, access, meaning in re.findall(pattern, PAGE, re.MULTILINE)
    ]
    code = [
        (e.name, e.address, e.address + e.size - 1, e.kind, ("r", "rw")[e.writable], e.meaning)
        for e in MAP
    ]
    assert page == code


def test_no_two_registers_overlap_and_every_name_is_unique():
    taken = [e.address + k for e in MAP for k in range(e.size)]
    assert len(taken) == len(set(taken))
    assert len({e.name for e in MAP}) == len(MAP)
    for entry in MAP:
        assert register(entry.name) is entry
        assert register_at(entry.address + entry.size - 1) is entry


@pytest.mark.parametrize("width", range(1, 7))
def test_a_block_fits_one_reply(width):
    # 253 bytes of PDU, less function code and byte count, in whole registers
    assert block_registers(width) <= 125
    assert block_registers(width) + width > 125, "one more scan would not fit"


def test_the_worked_example_of_the_page_is_what_the_node_answers():
    pairs = re.findall(r"```\n> ([0-9a-f\s]+?)\n< ([0-9a-f\s]+?)\n```", PAGE)
    assert len(pairs) == 9
    core = build_core(TinyBench(), PROFILE, 0, pace="fast", clock=Clock())
    for request_text, reply_text in pairs:
        request, reply = bytes.fromhex(request_text), bytes.fromhex(reply_text)
        assert struct.unpack(">H", request[4:6])[0] == len(request) - 6
        assert request[:4] == reply[:4]
        assert core.answer(request[7:], 1) == reply[7:]
    assert core.machine.starts == 1


@pytest.mark.parametrize("members", [State, Refusal])
def test_every_state_and_reason_stands_on_the_page(members):
    text = PAGE.lower()
    for member in members:
        word = member.name.split("_")[0].lower()
        assert member == 0 or word in text
        assert re.search(rf"\b{int(member)}\b", PAGE)


def test_every_read_only_register_refuses_a_write_with_exception_2():
    core = build_core(TinyBench(), PROFILE, 0, pace="fast", clock=Clock())
    for entry in MAP:
        if not entry.writable:
            request = struct.pack(">BHHB", 16, entry.address, entry.size, 2 * entry.size)
            reply = core.answer(request + bytes(2 * entry.size), 1)
            assert reply == b"\x90\x02", entry.name


@settings(max_examples=400, deadline=None)
@given(function=st.sampled_from([3, 6, 16, 23]) | st.integers(0, 127), rest=st.binary(max_size=60))
def test_any_bytes_as_a_request_get_an_answer_and_never_start_the_motor(function, rest):
    core = build_core(TinyBench(), PROFILE, 0, pace="fast", clock=Clock())
    reply = core.answer(bytes((function,)) + rest, 1)
    assert reply[0] in (function, function | 0x80)
    assert 2 <= len(reply) <= 253
    assert core.machine.starts == 0


FINITE = st.floats(-1e3, 1e3, width=32)


@settings(max_examples=100, deadline=None)
@given(
    counts=st.tuples(st.integers(0, 127), st.integers(1, 128), st.integers(0, 2**32 - 1)),
    volts=st.tuples(*[FINITE] * 5),
)
def test_a_group_is_the_same_after_a_round_trip(counts, volts):
    named = dict(zip([entry.name for entry in PROGRAM], (*counts, *volts), strict=True))
    raw = encode_group(PROGRAM, named)
    assert raw == struct.pack(">HHI5f", *counts, *volts)
    assert decode_group(PROGRAM, raw) == named


WORDS = st.tuples(*[st.integers(-32768, 32767)] * 4, st.integers(-(2**40), 2**40))


@settings(max_examples=200, deadline=None)
@given(scans=st.lists(WORDS, max_size=18), channels=st.integers(1, 63), echo=st.integers(0, 65535))
def test_a_block_is_the_same_after_a_round_trip(scans, channels, echo):
    codes = np.array([scan[:4] for scan in scans], dtype=np.int16).reshape(-1, 4)
    encoder = np.array([scan[4] for scan in scans], dtype=np.int64)
    header = BlockHeader(65535, 7, 2, 3, 2**32 - 1, channels)
    raw = seal_block(encode_block(header, encode_scans(codes, encoder)), echo)
    assert len(raw) == 250
    assert raw[:2] == struct.pack(">H", echo)
    assert block_fault(raw) == ""
    _, *told, first_count, _ = struct.unpack_from(">HHHHHHIiI", raw)
    assert told == [65535, 7, 2 | channels << 8, len(scans), 3, 2**32 - 1]
    wrapped = (encoder + 2**31) % 2**32 - 2**31
    high, low = wrapped >> 16, wrapped & 0xFFFF
    whole = np.column_stack((codes, high, low)).astype(np.uint16).view(np.int16)
    chosen = [bit for bit in range(6) if channels >> bit & 1]
    words = np.frombuffer(raw, ">i2", count=len(scans) * len(chosen), offset=24)
    np.testing.assert_array_equal(words.reshape(-1, len(chosen)), whole[:, chosen])
    assert first_count == (wrapped[0] if len(scans) else 0)


@settings(max_examples=300, deadline=None)
@given(byte=st.integers(0, 23 + 2 * 6 * 18), change=st.integers(1, 255))
def test_a_block_with_one_wrong_byte_is_refused(byte, change):
    """CRC-32 finds every burst of up to 32 bits (Peterson and Brown, Proc. IRE 49, 1961)."""
    index = np.arange(18)
    codes = np.column_stack([index * 1000 + k for k in range(4)]).astype(np.int16)
    header = BlockHeader(1, 1, 2, 0, 0, 63)
    raw = bytearray(seal_block(encode_block(header, encode_scans(codes, index * 70_001)), 9))
    raw[byte] ^= change
    assert block_fault(bytes(raw))


def test_the_checksum_is_the_crc_32_of_ieee_802_3():
    """Check value of the catalogue: "123456789" gives 0xCBF43926."""
    header = BlockHeader(2, 3, 2, 0, 5, 1)
    codes = np.array([[0x1234, 0, 0, 0]], dtype=np.int16)
    raw = seal_block(encode_block(header, encode_scans(codes, np.zeros(1, np.int64))), 0xBEEF)
    assert zlib.crc32(b"123456789") == 0xCBF43926
    assert int.from_bytes(raw[20:24], "big") == zlib.crc32(raw[:20] + b"\x12\x34")


@pytest.mark.parametrize("raw", [b"", bytes(19), bytes(250)])
def test_a_block_that_no_node_sent_is_refused(raw):
    assert "checksum" in block_fault(raw)


def test_the_parameter_block_has_the_order_of_the_reports_node():
    # listing A.1 copies them one by one in this order
    first = "bias_v sample_period_ns n_samples amplitude_v wave frequency_hz duty"
    assert [entry.name for entry in PARAMETERS[:7]] == first.split()
