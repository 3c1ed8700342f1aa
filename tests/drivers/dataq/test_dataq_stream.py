"""The stream: rates, scan lists, words to volts, and what happens when it is out of step."""

import itertools

import numpy as np
import pytest
from dataqkit import ROLES, table
from hypothesis import given, settings
from hypothesis import strategies as st

from hdbench.drivers.dataq.scans import (
    MODELS,
    LagWatch,
    ScanAssembler,
    SignedCounter,
    StreamFault,
    choose_rate,
    highest_rate_hz,
    packet_code,
    plan_scan,
)
from hdbench.errors import DeviceError, ProfileError

OPEN = 0x7F00


# products by hand: 60 MHz at 1 kHz is 60000; a DI-2108P shares 120 MHz among its entries
@pytest.mark.parametrize(
    ("model", "entries", "period_s", "average", "numbers"),
    [
        ("DI-2108", 5, 1e-3, 1, (60000, 1, 1)),
        ("DI-4108", 5, 1e-3, 10, (6000, 10, 1)),
        ("DI-1110", 3, 1e-2, 1, (60000, 1, 10)),
        ("DI-2108P", 5, 1e-3, 1, (24000, 1, 1)),
        ("DI-2008", 5, 0.1, 1, (16, 1, 1)),
        ("DI-1100", 4, 1e-3, 1, (60000, 1, 1)),
    ],
)
def test_a_period_becomes_the_instrument_s_three_numbers(
    model, entries, period_s, average, numbers
):
    found = choose_rate(MODELS[model], entries, period_s, average)
    assert (found.srate, found.dec, found.deca) == numbers
    assert found.period_s == pytest.approx(period_s, rel=1e-12)


@pytest.mark.parametrize(
    ("model", "period_s", "average"),
    [("DI-2008", 1e-3, 1), ("DI-1100", 1e-2, 1), ("DI-1110", 1e-3, 10)],
)
def test_a_period_that_a_model_does_not_have_is_refused(model, period_s, average):
    with pytest.raises(DeviceError, match="has no period of"):
        choose_rate(MODELS[model], 4, period_s, average)


@settings(deadline=None, max_examples=30)
@given(st.sampled_from(sorted(MODELS)), st.integers(1, 6), st.floats(2e-4, 1.0))
def test_every_setting_keeps_the_model_s_limits(name, entries, period_s):
    model = MODELS[name]
    try:
        found = choose_rate(model, entries, period_s, 1)
    except DeviceError:
        return
    assert model.shortest(entries) <= found.srate <= model.srate_max
    assert 1 <= found.dec <= model.dec_max
    assert 1 <= found.deca <= model.deca_max
    assert abs(found.period_s - period_s) <= 1e-4 * period_s
    rate_hz = model.clock_hz(entries) / (found.srate * found.dec * found.deca)
    assert 1.0 / rate_hz == pytest.approx(found.period_s)


def test_a_packet_fills_within_25_ms_and_a_rate_leaves_50_ms_in_the_buffer():
    assert packet_code(5, 1e-3) == 3  # 128 bytes of 10 kB/s are 12.8 ms, 256 would be 25.6 ms
    assert packet_code(5, 0.1) == 0
    assert highest_rate_hz(MODELS["DI-4108"], 5) == 1024 / 5 / 0.05


@pytest.mark.parametrize("count", range(1, 5))
def test_a_scan_ends_with_the_digital_inputs_and_never_fits_a_packet(count):
    plan = plan_scan(table(), ROLES[:count])
    assert plan.words[-1] == 8
    words = len(plan.words)
    assert words & (words - 1)


def test_scan_words_carry_channel_and_range():
    assert plan_scan(table("DI-4208", range_v=20.0), ROLES).words[:2] == (0x200, 0x201)
    assert plan_scan(table("DI-2008"), ROLES).words[0] == 0x0A00
    with pytest.raises(ProfileError, match=r"range_v 3 V; a DI-4108 has 10, 5, 2, 1, 0\.5, 0\.2 V"):
        plan_scan(table("DI-4108", range_v=3.0), ROLES)


def test_an_encoder_needs_the_counter_and_nothing_else_may_have_it():
    made = table(roles=("torque", "tacho", "encoder"))
    assert plan_scan(made, ("torque", "tacho", "encoder")).words == (0, 1, 10, 0x0109, 8)
    analog = made.channels[2].model_copy(update={"input": "analog 3"})
    wrong = made.model_copy(update={"channels": (analog,)})
    with pytest.raises(ProfileError, match="an encoder needs the counter"):
        plan_scan(wrong, ("encoder",))
    with pytest.raises(ProfileError, match="an encoder needs the counter"):
        plan_scan(table("DI-1100", ("tacho", "encoder")), ("tacho", "encoder"))


def test_a_counter_s_edges_get_the_direction_of_the_tacho():
    """Forward 70000 edges, through a wrap, and back by 10."""
    counter = SignedCounter(4)
    edges = np.concatenate([np.arange(0, 70_001, 1000), [70_005, 70_010]]) % 65536
    # it turns round just before the first sample on its way back
    tacho = np.concatenate([np.ones(70), [0.1, -1.0, -1.0]])
    found = np.concatenate([counter(edges[:30], tacho[:30]), counter(edges[30:], tacho[30:])])
    # two counts: the middle of what one edge leaves open
    assert list(found[[0, 70, 71, 72]]) == [2, 280_002, 279_982, 279_962]
    # an edge before the turn, and the sample after it
    turned = SignedCounter(4)(np.array([0.0, 10, 11]), np.array([1.0, 1.0, -0.2]))
    assert list(turned) == [2, 42, 46]


# page 60 to 70 of the protocol: volts = range counts / 32768; 10 (i16 >> 4) / 2048 with 12 bits
@pytest.mark.parametrize(
    ("model", "word", "volts"),
    [
        ("DI-2108", 16384, 5.0),
        ("DI-2108", -32768, -10.0),
        ("DI-1110", 0x4000, 10 * (0x4000 >> 4) / 2048),
        ("DI-1110", -16, -10 / 2048),
        ("DI-1100", 0x4003, 5.0),
        ("DI-1120", 4, 10 / 8192),
        ("DI-4718B", 16384, 2.5),
    ],
)
def test_words_become_volts_as_the_protocol_says(model, word, volts):
    plan = plan_scan(table(model, roles=("torque", "tacho")), ("torque", "tacho"))
    words = np.zeros((1, len(plan.words)), dtype=np.int16)
    words[0, 0] = word
    values, saturated = plan.decode(words)
    assert values[0, 0] == pytest.approx(volts, abs=1e-12)
    assert bool(saturated[0, 0]) == (word == -32768)


def stream(count=60, seed=0, n_words=5):
    random = np.random.default_rng(seed)
    words = random.integers(-32768, 32768, (count, n_words)).astype(np.int16)
    # the mark, and no analog word that happens to be the same
    words[words == OPEN] = 0
    words[:, -1] = OPEN
    return words


def delivered(data, cuts=()):
    """Return the scans that come out, and whether a fault was told."""
    assembler = ScanAssembler(plan_scan(table(), ROLES))
    found = [np.zeros((0, 5))]
    pieces = [data[start:end] for start, end in itertools.pairwise((0, *cuts, len(data)))]
    try:
        for piece in (*pieces, b""):
            found.append(assembler.take(piece))
    except StreamFault:
        return np.concatenate(found), True
    return np.concatenate(found), False


@given(st.lists(st.integers(0, 600), max_size=8))
def test_a_stream_cut_anywhere_gives_the_same_scans(cuts):
    words = stream()
    found, fault = delivered(words.astype("<i2").tobytes(), tuple(sorted(cuts)))
    assert not fault
    assert np.array_equal(found, words)


@pytest.mark.parametrize("size", [1, 2, 3, 5, 7, 9, 11, 16, 64, 512])
@pytest.mark.parametrize("act", ["lost", "inserted"])
def test_bytes_too_few_or_too_many_never_become_a_sample(size, act):
    """All places in two scans; a size that is no whole number of scans is always told."""
    words = stream(80, seed=size)
    data = words.astype("<i2").tobytes()
    extra = np.random.default_rng(size).bytes(size)
    for at in range(20, 40):
        spoilt = data[:at] + (extra + data[at:] if act == "inserted" else data[at + size :])
        found, fault = delivered(spoilt)
        assert fault
        assert np.array_equal(found, words[: len(found)])


def test_text_in_the_place_of_samples_is_told_as_an_overflow():
    assembler = ScanAssembler(plan_scan(table(), ROLES))
    data = stream(20).astype("<i2").tobytes()
    assert len(assembler.take(data[:-3] + b"stop 01")) == 19
    assert assembler.overflowed


def test_whole_scans_that_are_missing_show_against_the_clock():
    watch = LagWatch(1e-3, 0.05)
    for packet in range(400):
        lost = 64 if packet >= 200 else 0
        jitter_s = 0.004 * (packet % 3)
        missing = watch.missing(13 * (packet + 1) - lost, 0.013 * (packet + 1) + jitter_s)
        if missing:
            break
    assert 200 < packet < 280
    assert missing == pytest.approx(64, abs=5)


def test_jitter_and_a_late_host_are_no_loss():
    watch = LagWatch(1e-3, 0.05)
    random = np.random.default_rng(1)
    late_s = np.where(np.arange(2000) % 300 > 280, 0.4, 0.0) + random.uniform(0, 0.02, 2000)
    # 100 ppm of difference between the clocks
    times = 0.013 * np.arange(1, 2001) * 1.0001 + late_s
    assert not any(watch.missing(13 * (n + 1), t) for n, t in enumerate(times))
