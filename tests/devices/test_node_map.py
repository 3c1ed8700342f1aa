"""The protocol page says what the code does, byte for byte."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nodekit import PROFILE, ManualClock, TinyBench

from hdbench.devices.emulator.answer import answer
from hdbench.devices.emulator.serve import build_core
from hdbench.devices.node.codec import (
    as_float32,
    decode_block,
    decode_group,
    encode_block,
    encode_group,
    encode_scans,
)
from hdbench.devices.node.registers import (
    BLOCK_REGISTERS,
    FIXTURE,
    MAP,
    PARAMETERS,
    Refusal,
    State,
    register,
    register_at,
)

PAGE = (Path(__file__).parents[2] / "docs" / "node-protocol.md").read_text(encoding="utf-8")


def test_the_table_of_the_page_is_the_map_of_the_code():
    pattern = r"^\| (0x[0-9A-F]{4})(?:-(0x[0-9A-F]{4}))? \| `(\w+)` \| (\w+) \| (r|rw) \| (.+) \|$"
    page = [
        (name, int(first, 16), int(last or first, 16), kind, access, meaning)
        for first, last, name, kind, access, meaning in re.findall(pattern, PAGE, re.MULTILINE)
    ]
    code = [(e.name, e.address, e.address + e.size - 1, e.kind, e.access, e.meaning) for e in MAP]
    assert page == code


def test_no_two_registers_overlap_and_every_name_is_unique():
    taken = [e.address + k for e in MAP for k in range(e.size)]
    assert len(taken) == len(set(taken))
    assert len({e.name for e in MAP}) == len(MAP)
    for entry in MAP:
        assert register(entry.name) is entry
        assert register_at(entry.address + entry.size - 1) is entry


def test_a_block_fits_one_reply():
    # 253 bytes of PDU, less function code and byte count, in whole registers
    assert BLOCK_REGISTERS <= 125
    assert BLOCK_REGISTERS + 6 > 125, "one more scan would not fit"


def test_the_worked_example_of_the_page_is_what_the_node_answers():
    pairs = re.findall(r"```\n> ([0-9a-f\s]+?)\n< ([0-9a-f\s]+?)\n```", PAGE)
    assert len(pairs) == 9
    core = build_core(TinyBench(), PROFILE, 0, pace="fast", clock=ManualClock())
    for request_text, reply_text in pairs:
        request, reply = bytes.fromhex(request_text), bytes.fromhex(reply_text)
        assert struct.unpack(">H", request[4:6])[0] == len(request) - 6
        assert request[:4] == reply[:4]
        assert answer(request[7:], core, 1) == reply[7:]
    assert core.machine.starts == 1


@pytest.mark.parametrize("members", [State, Refusal])
def test_every_state_and_reason_stands_on_the_page(members):
    text = PAGE.lower()
    for member in members:
        word = member.name.split("_")[0].lower()
        assert member == 0 or word in text
        assert re.search(rf"\b{int(member)}\b", PAGE)


def test_every_read_only_register_refuses_a_write_with_exception_2():
    core = build_core(TinyBench(), PROFILE, 0, pace="fast", clock=ManualClock())
    for entry in MAP:
        if entry.access == "r":
            request = struct.pack(">BHHB", 16, entry.address, entry.size, 2 * entry.size)
            assert answer(request + bytes(2 * entry.size), core, 1) == b"\x90\x02", entry.name


def test_any_bytes_as_a_request_get_an_answer_and_never_start_the_motor():
    @settings(max_examples=400, deadline=None)
    @given(
        function=st.sampled_from([3, 6, 16, 23]) | st.integers(0, 127),
        rest=st.binary(max_size=60),
    )
    def check(function, rest):
        core = build_core(TinyBench(), PROFILE, 0, pace="fast", clock=ManualClock())
        reply = answer(bytes((function,)) + rest, core, 1)
        assert reply[0] in (function, function | 0x80)
        assert 2 <= len(reply) <= 253
        assert core.machine.starts == 0

    check()


FINITE = st.floats(-1e3, 1e3, width=32)


@settings(max_examples=100, deadline=None)
@given(values=st.tuples(st.integers(0, 1), st.sampled_from([-1, 1]), FINITE, FINITE))
def test_a_group_is_the_same_after_a_round_trip(values):
    named = dict(zip([entry.name for entry in FIXTURE], values, strict=True))
    raw = encode_group(FIXTURE, named)
    assert raw == struct.pack(">Hhff", *values)
    assert decode_group(FIXTURE, raw) == named


@settings(max_examples=100, deadline=None)
@given(
    scans=st.lists(
        st.tuples(*[st.integers(-32768, 32767)] * 4, st.integers(-(2**40), 2**40)), max_size=19
    )
)
def test_a_block_is_the_same_after_a_round_trip(scans):
    codes = np.array([scan[:4] for scan in scans], dtype=np.int16).reshape(-1, 4)
    encoder = np.array([scan[4] for scan in scans], dtype=np.int64)
    raw = encode_block(7, 2, 3, 2**32 - 1, encode_scans(codes, encoder))
    assert len(raw) == 2 * BLOCK_REGISTERS
    block = decode_block(raw)
    assert (block.seq, block.flags, block.depth, block.first_index) == (7, 2, 3, 2**32 - 1)
    np.testing.assert_array_equal(block.codes, codes)
    np.testing.assert_array_equal(block.encoder, (encoder + 2**31) % 2**32 - 2**31)


@pytest.mark.parametrize("raw", [b"", bytes(239), bytes(4) + b"\0\x14" + bytes(234)])
def test_a_block_of_impossible_size_is_refused(raw):
    broken = raw if len(raw) < 240 else b"\0\1\0\0\0\x14" + bytes(234)
    with pytest.raises(ValueError, match="needed"):
        decode_block(broken)


def test_the_parameter_block_has_the_order_of_the_reports_node():
    # listing A.1 copies them one by one in this order
    names = [entry.name for entry in PARAMETERS]
    assert names[:7] == [
        "bias_v",
        "sample_period_ns",
        "n_samples",
        "amplitude_v",
        "wave",
        "frequency_hz",
        "duty",
    ]


def test_volts_are_rounded_to_single_precision_and_no_further():
    assert as_float32(2.773) == struct.unpack(">f", struct.pack(">f", 2.773))[0]
