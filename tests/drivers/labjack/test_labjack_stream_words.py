"""Packets, scans and volts against bytes made by hand."""

import itertools
import struct
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hdbench.drivers.labjack.scanlist import (
    InputScale,
    StreamSetup,
    nominal_scale,
    scale_from_flash,
)
from hdbench.drivers.labjack.stream import PacketParser, ScanAssembler, StreamFault

# three words a scan: an input, then the core timer; 1 kHz is 40 000 ticks of 25 ns
SCANS = 4
SAMPLES = SCANS * 3
LAYOUT = (3, 1, StreamSetup(1e-3, SAMPLES))


def flat(parts) -> list[int]:
    return list(itertools.chain.from_iterable(parts))


def scan(index: int) -> list[int]:
    ticks = (7_000_000_00 + 40_000 * index) % 2**32
    return [index % 60_000, ticks & 0xFFFF, ticks >> 16]


def packet(number: int, first: int, *, words: list[int] | None = None, **header: int) -> bytes:
    data = words or flat(scan(first + n) for n in range(SCANS))
    fields = {"protocol": 0, "length": 10 + 2 * len(data), "unit": 1, "function": 76, "type": 16}
    fields |= {"reserved": 0, "backlog": 0, "status": 0, "additional": 0, **header}
    return struct.pack(f">HHHBBBBHHH{len(data)}H", number, *fields.values(), *data)


def delivered(data: bytes, *, split: int | None = None) -> list[tuple[int, int, list[int]]]:
    """Return first index, lost and first words of the runs that come out of `data`."""
    parser, scans = PacketParser(SAMPLES), ScanAssembler(*LAYOUT)
    size = split or len(data)
    fed = (parser.feed(data[at : at + size]) for at in range(0, len(data), size))
    runs = flat(map(scans.take, itertools.chain(*fed, parser.finish())))
    return [(run.first_index, run.lost_before, run.words[:, 0].tolist()) for run in runs]


@pytest.mark.parametrize("split", [1, 7, 16, 41, 1000])
def test_packets_come_out_whole_however_the_bytes_arrive(split):
    runs = delivered(b"".join(packet(n, SCANS * n) for n in range(5)), split=split)
    assert [run[:2] for run in runs] == [(first, 0) for first in (0, 4, 8, 12, 16)]
    assert flat(run[2] for run in runs) == list(range(20))


def test_missing_packets_are_counted_and_confirmed_by_the_timer():
    data = packet(0, 0) + packet(3, 12) + packet(4, 16)
    assert [run[:2] for run in delivered(data)] == [(0, 0), (12, 8), (16, 0)]


JUMPING = [*scan(4), *scan(5), *scan(8), *scan(9)]
# scans 4 and 5, the joint after a full buffer, scan 106
JOINED = [*scan(4), *scan(5), 0xFFFF, 0xFFFF, 0xFFFF, *scan(106)]


@pytest.mark.parametrize(
    ("packets", "told"),
    [
        # one flipped bit of the number; what follows tells that it was wrong
        (packet(1 ^ 0x100, 4) + packet(2, 8) + packet(3, 12), "followed by packet 2"),
        # numbers jump by 2 and go on, samples do not: a device that counts wrongly
        (packet(3, 4) + packet(4, 8), "missing by the core timer"),
        # a jump of the samples that no number tells, between packets and within one
        (packet(1, 9) + packet(2, 13), r"5\.00 scans are missing"),
        (packet(1, 4, words=JUMPING) + packet(2, 10), "jumps at scan 6"),
        # a packet that comes late
        (packet(2, 8) + packet(1, 4) + packet(3, 12), "followed by packet 1"),
        # a gap of 90 scans by the device, of 100 by the timer
        (
            packet(1, 4, words=JOINED, status=2941, additional=90) + packet(2, 107),
            r"100\.00 scans are missing by the core timer",
        ),
    ],
)
def test_packets_that_cannot_be_placed_in_time_are_refused(packets, told):
    with pytest.raises(StreamFault, match=told):
        delivered(packet(0, 0) + packets)


def test_a_packet_that_comes_twice_counts_once():
    twice = packet(0, 0) + packet(1, 4) * 2 + packet(2, 8)
    assert [run[0] for run in delivered(twice)] == [0, 4, 8]


@pytest.mark.parametrize("joint_counts", [0, 1])
def test_after_a_full_buffer_the_gap_is_exact_whichever_way_the_device_counts(joint_counts):
    # scans 0 to 5, then 100 scans that were never sampled, a joint, and scans 106 to 107
    data = (
        packet(0, 0, status=2940)
        + packet(1, 4, words=JOINED, status=2941, additional=100 + joint_counts)
        + packet(2, 107)
    )
    assert [run[:2] for run in delivered(data)] == [(0, 0), (4, 0), (106, 100), (107, 0)]


@pytest.mark.parametrize(
    ("field", "value"),
    [("protocol", 1), ("unit", 2), ("function", 3), ("type", 17),
     *(("length", size) for size in (10 + 2 * SAMPLES - 2, 10 + 2 * SAMPLES + 1, 0))],
)  # fmt: skip
def test_a_header_that_is_none_ends_the_stream_before_its_samples(field, value):
    wrong = packet(1, 4, **{field: value})
    certain = PacketParser(SAMPLES).feed(packet(0, 0) + wrong + packet(2, 8))
    with pytest.raises(StreamFault):
        next(certain)


def test_bytes_missing_within_a_packet_keep_that_packet_back():
    for cut in range(1, len(packet(1, 4))):
        data = packet(0, 0) + packet(1, 4)[:-cut] + packet(2, 8) + packet(3, 12)
        parser, scans = PacketParser(SAMPLES), ScanAssembler(*LAYOUT)
        runs = []
        with suppress(StreamFault):
            for each in parser.feed(data):
                runs += scans.take(each)
        words = [run.words[:, 0].tolist() for run in runs]
        assert words in ([list(range(4))], []), f"{cut} bytes missing"


@settings(max_examples=300, deadline=None)
@given(bit=st.integers(0, 8 * len(packet(1, 4)) - 1))
def test_a_flipped_bit_is_found_or_stays_within_a_single_value(bit):
    changed = bytearray(packet(1, 4))
    changed[bit // 8] ^= 0x80 >> bit % 8
    data = packet(0, 0) + bytes(changed) + packet(2, 8) + packet(3, 12)
    try:
        runs = delivered(data)
    except StreamFault:
        return
    values = flat(run[2] for run in runs)
    assert [run[:2] for run in runs] == [(0, 0), (4, 0), (8, 0), (12, 0)]
    # an input's own value: 16 bits without a checksum, which the wire cannot tell
    assert sum(value != n for n, value in zip(range(16), values, strict=True)) <= 1
    # no check sees what stands from here on: reserved, backlog, words that inform, and values
    assert bit // 8 >= 9


def test_numbers_and_timer_wrap():
    first = 65_533
    parser, scans = PacketParser(SAMPLES), ScanAssembler(*LAYOUT)
    parser._next = first
    offset = (2**32 - 7_000_000_00) // 40_000 - 6
    data = b"".join(packet((first + n) % 65536, offset + SCANS * n) for n in range(6))
    runs = list(itertools.chain(*(scans.take(each) for each in parser.feed(data))))
    assert [run.lost_before for run in runs] == [0] * 5
    ticks = [int(run.words[0, 2]) for run in runs]
    assert ticks[-1] < ticks[0], "the timer has wrapped within the record"


def test_nominal_volts_are_those_of_the_data_sheet():
    # T7, +-10 V: centre word 33523 is 0 V, and the ends are beyond the range
    scale = nominal_scale("T7", 0, 10.0)
    words = np.array([33523, 0, 65535, 33523 + 31665], dtype=np.uint16)
    assert scale.volts(words) == pytest.approx([0.0, -10.58676, 10.10958, 10.0], abs=2e-4)
    assert nominal_scale("T7", 0, 0.01).volts(words)[1] == pytest.approx(-0.01058676, rel=1e-6)
    # T4, AIN0 to AIN3: slope and offset of the data sheet
    t4 = nominal_scale("T4", 1, 10.0)
    assert t4.volts(np.array([65535, 0], dtype=np.uint16)) == pytest.approx([10.669679, -10.532965])


def test_flash_constants_are_taken_by_gain_and_refused_when_absurd():
    words = [0.0] * 41
    for gain, range_v in enumerate((10.0, 1.0, 0.1, 0.01)):
        slope = 3.16e-5 * range_v
        words[4 * gain : 4 * gain + 4] = [slope, -slope, 33500.0 + gain, 0.0]
    scale = scale_from_flash("T7", words, 2, 0.1)
    assert scale == InputScale(33502.0, pytest.approx(3.16e-6), pytest.approx(-3.16e-6))
    words[8] = float("nan")
    assert scale_from_flash("T7", words, 2, 0.1) is None
    words[8] = 0.0
    assert scale_from_flash("T7", words, 2, 0.1) is None
    t4 = [3.23e-4, -10.5] * 4 + [3.8e-5, 0.0] + [0.0] * 9
    scale = scale_from_flash("T4", t4, 3, 10.0)
    assert scale.volts(np.array([40000], dtype=np.uint16))[0] == pytest.approx(2.42)
