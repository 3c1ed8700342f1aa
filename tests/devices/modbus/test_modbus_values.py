"""Registers: types, orders, numbers, and which requests read them."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from modbuskit import table
from pymodbus.client.mixin import ModbusClientMixin

from hdbench.devices.modbus.driver import max_rates_hz
from hdbench.devices.modbus.layout import place_of, plan_blocks, values_of
from hdbench.devices.registers import Register, decode, encode, size_of
from hdbench.profile import load_profile

KINDS = ("i16", "u16", "i32", "u32", "f32", "f64")
ORDERS = ("ABCD", "CDAB", "BADC", "DCBA")


# 123456.0 is 47 F1 20 00 as IEEE 754 single
@pytest.mark.parametrize(
    ("order", "wire"),
    [("ABCD", "47f12000"), ("CDAB", "200047f1"), ("BADC", "f1470020"), ("DCBA", "0020f147")],
)
def test_the_four_orders_are_those_of_their_letters(order, wire):
    assert encode(123456.0, "f32", order).hex() == wire
    assert decode(bytes.fromhex(wire), "f32", order) == 123456.0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("word_order", ["big", "little"])
def test_another_library_reads_the_same_values(kind, word_order):
    names = {"i": "INT", "u": "UINT", "f": "FLOAT"}
    data = getattr(ModbusClientMixin.DATATYPE, names[kind[0]] + kind[1:])
    value = 1234.0 if kind[0] == "u" else -1234.0
    raw = encode(value, kind, "ABCD" if word_order == "big" else "CDAB")
    words = list(struct.unpack(f">{size_of(kind)}H", raw))
    assert ModbusClientMixin.convert_from_registers(words, data, word_order=word_order) == value


@given(st.sampled_from(KINDS), st.sampled_from(ORDERS), st.binary(min_size=8, max_size=8))
def test_what_was_read_is_written_as_the_same_bytes(kind, order, data):
    raw = data[: 2 * size_of(kind)]
    value = decode(raw, kind, order)
    if math.isfinite(value):
        assert encode(value, kind, order) == raw


@pytest.mark.parametrize("value", [math.nan, math.inf, 40000.0, -40000.0])
def test_a_value_that_a_type_does_not_hold_is_refused(value):
    with pytest.raises(ValueError, match="i16"):
        encode(value, "i16", "ABCD")


@pytest.mark.parametrize(
    ("numbering", "where", "address", "wire"),
    [
        ("zero", "holding", 100, 100),
        ("one", "holding", 100, 99),
        ("modicon", "holding", 40001, 0),
        ("modicon", "holding", 465536, 65535),
        ("modicon", "input", 30017, 16),
        ("modicon", "discrete", 10003, 2),
        ("modicon", "coil", 262, 261),
    ],
)
def test_addresses_count_as_the_manual_does(numbering, where, address, wire):
    rule = {"table": where, "address": address, "equals": 1}
    made = table(numbering=numbering, identify=(rule,), channels=())
    assert place_of(made, made.identify[0]).address == wire


def _place(start, kind="u16", space="holding"):
    return Register(str(start), start, kind, space=space)


def test_adjacent_values_come_in_one_request_and_others_do_not():
    places = [*(_place(n, "f32") for n in (4, 0, 2)), _place(7), _place(0, "u16", "input")]

    def planned(bridge):
        blocks = plan_blocks(places, most=125, bridge=bridge)
        return [(block.space, block.start, block.size) for block in blocks]

    assert planned(0) == [("holding", 0, 6), ("holding", 7, 1), ("input", 0, 1)]
    assert planned(1) == [("holding", 0, 8), ("input", 0, 1)]


@pytest.mark.parametrize("most", [2, 5, 32, 125])
def test_no_request_is_longer_than_the_device_allows_and_no_value_is_cut(most):
    places = [_place(2 * number, "f32") for number in range(100)]
    blocks = plan_blocks(places, most=most, bridge=0)
    assert max(block.size for block in blocks) <= most
    assert all(any(block.holds(place) for block in blocks) for place in places)
    assert len(blocks) == math.ceil(100 / (most // 2))


def test_values_are_cut_out_of_their_block():
    places = [_place(0, "u16"), _place(1, "i32"), Register("c", 9, "u16", space="coil")]
    blocks = plan_blocks(places, most=125, bridge=0)
    replies = dict(zip(blocks, (b"\x01", bytes.fromhex("00fffffffffe")), strict=True))
    assert values_of(places, replies) == [255, -2, 1]


def test_a_slow_line_says_how_fast_it_is():
    """38400 bit/s, 10 bits a character: 8 characters out, 9 in, 3.5 before and after, 10 ms."""
    seneca = load_profile("seneca-z-sg").data.daq.model_copy(update={"refresh_hz": None})
    exchange_s = (8 + 9 + 7) * 10 / 38400 + 0.01
    assert max_rates_hz(seneca) == pytest.approx((1.0 / exchange_s,))


def test_a_device_is_not_polled_more_often_than_it_renews_its_values():
    assert max_rates_hz(load_profile("adam-6024").data.daq)[-1] == 10.0


def test_the_motor_reference_takes_its_share_of_the_line():
    alone = table(reply_s=0.004)
    driving = table(
        reply_s=0.004,
        identify=({"address": 1, "equals": 1},),
        output={"address": 50, "limit_v": 1.0, "update_s": 0.02, "scale": 0.001},
    )
    # a write and its read-back, 4 ms each, every 20 ms: two fifths of the time
    assert max_rates_hz(driving)[0] == pytest.approx(0.6 * max_rates_hz(alone)[0])
