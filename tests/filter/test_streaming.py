"""Blocks of any split, restarts, gaps and lost samples; stored traces and their channels."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from filter_oracle import literal, motion
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_models import filter_model
from numpy.testing import assert_allclose, assert_array_equal
from tuning_traces import GUARDED, compiled_kernel

from hdbench.errors import DataError
from hdbench.filter import FilteredBlock, OnlineFilter, OscillatorBlock, filter_trace, preset
from hdbench.records import Trace

BLOCKS = (OscillatorBlock(2.0, "ripple", 0.1), OscillatorBlock(0.01, "misalignment", 1e-3))
MODEL = filter_model(BLOCKS, 0.5, inertia=1.725e-2, angle=True)
FIELDS = (
    *("torque_expected_nm", "ripple_nm", "misalignment_nm", "torque_filtered_nm"),
    *("slow_nm", "flags"),
)


def columns(block: FilteredBlock) -> np.ndarray:
    return np.stack([getattr(block, name) for name in FIELDS])


def damaged(n=500):
    t, v, y, angle = motion(n)
    rng = np.random.default_rng(9)
    for array, share in ((v, 0.05), (y, 0.1), (angle, 0.1)):
        array[rng.random(n) < share] = np.nan
    t[n // 2 :] += 0.2
    # beyond the limit and stuck, for a model that looks at both
    y[300:320] = -30.0
    y[100:140] = y[n - 10 :] = 1.5
    return t, v, y, angle


@settings(max_examples=30)
@given(
    st.lists(st.integers(0, 500), max_size=12),
    st.sampled_from(["c", "numpy"] if compiled_kernel() else ["numpy"]),
    st.lists(st.floats(0.01, 9.0), max_size=6, unique=True),
)
def test_blocks_of_any_split_give_the_same_bits_as_one_call(cuts, form, orders):
    data = damaged()
    blocks = tuple(OscillatorBlock(o, "ripple", 0.1) for o in orders)
    model = replace(MODEL, blocks=blocks) if blocks else GUARDED
    whole = columns(OnlineFilter(model, kernel=form).process(*data))
    online = OnlineFilter(model, kernel=form)
    ends = pairwise([0, *sorted(cuts), 500])
    parts = [columns(online.process(*(channel[a:b] for channel in data))) for a, b in ends]
    assert_array_equal(np.concatenate(parts, axis=1), whole)


@pytest.mark.parametrize("cut", [0, 1, 120, 310, 495])
@pytest.mark.parametrize("model", [MODEL, GUARDED], ids=["report", "guarded"])
def test_a_restored_state_goes_on_with_the_same_bits(kernel, model, cut):
    data = damaged()
    whole = columns(OnlineFilter(model, kernel=kernel).process(*data))
    first = OnlineFilter(model, kernel=kernel)
    first.process(*(c[:cut] for c in data))
    kept = first.state()
    first.process(*(c[cut:] for c in data))
    second = OnlineFilter(model, kernel=kernel)
    second.restore([float(repr(number)) for number in kept.tolist()])
    rest = columns(second.process(*(c[cut:] for c in data)))
    assert_array_equal(rest, whole[:, cut:])


@pytest.mark.parametrize(
    "state",
    [[0.0, 1.0], np.full(23, np.nan), np.zeros(60), OnlineFilter(GUARDED).state()],
    ids=["short", "nan", "long", "screened"],
)
def test_a_foreign_state_is_refused(state):
    with pytest.raises(DataError, match="filter state"):
        OnlineFilter(MODEL).restore(state)


@pytest.mark.parametrize("lost", ["torque", "velocity", "both"])
def test_a_lost_sample_only_predicts(bench, kernel, lost):
    t, v, y, _ = motion(1200)
    gap = slice(600, 640)
    use = np.ones(1200, bool)
    use[gap] = False
    held = v.copy()
    torque, velocity = y.copy(), v.copy()
    if lost != "velocity":
        torque[gap] = np.nan
    if lost != "torque":
        velocity[gap] = np.nan
        held[gap] = v[599]
    block = OnlineFilter(preset("report-6", bench), kernel=kernel).process(t, velocity, torque)
    # before the gap and in it, predictions are those of the literal equations without update
    wanted = literal(t, held, y, [2, 4, 0.01], [1000, 1000, 0.05], use=use).sum(axis=1)
    found = block.ripple_nm + block.misalignment_nm
    assert_allclose(found[:641], wanted[:641], rtol=0.0, atol=1e-9)
    assert_array_equal(np.isnan(block.torque_filtered_nm), np.isnan(torque))
    assert np.isfinite(found).all()
    # the filter forgets a wrong start within a few turns: some seconds later the gap is gone
    whole = OnlineFilter(preset("report-6", bench), kernel=kernel).process(t, v, y)
    assert_allclose(block.torque_filtered_nm[-200:], whole.torque_filtered_nm[-200:], atol=0.05)


def test_a_lost_velocity_holds_the_expected_torque_and_spans_the_gap_after(bench, kernel):
    t = np.arange(50) * 1e-3
    v = 100.0 * t
    v[20:30] = np.nan
    expected = OnlineFilter(preset("report-a1", bench), kernel=kernel).process(t, v, 0.0 * t)
    acceleration = expected.torque_expected_nm * 100.0 / 1.725e-2
    assert_array_equal(acceleration[20:30], np.full(10, acceleration[19]))
    # Tustin over the true 11 ms since the last velocity: a = (2 * 1.1 + (10 - 11) ms * a1) / 21 ms
    wanted = (2 * 1.1 + (0.010 - 0.011) * acceleration[19]) / (0.010 + 0.011)
    # a dozen roundings
    assert_allclose(acceleration[30], wanted, rtol=1e-12)


@pytest.mark.parametrize("value", [np.inf, -np.inf, 1e300, -1.01e12])
@pytest.mark.parametrize("channel", [1, 2, 3])
def test_an_impossible_value_counts_as_missing_and_never_poisons_the_state(kernel, channel, value):
    impossible, missing = motion(400), motion(400)
    where = [0, 50, 51, 399]
    impossible[channel][where] = value
    missing[channel][where] = np.nan
    one, other = OnlineFilter(MODEL, kernel=kernel), OnlineFilter(MODEL, kernel=kernel)
    found = columns(one.process(*impossible))
    assert_array_equal(found, columns(other.process(*missing)))
    assert_array_equal(one.state(), other.state())
    assert np.isfinite(one.state()).all()
    assert np.isfinite(found[:3]).all()
    assert_array_equal(np.flatnonzero(np.isnan(found[3])), where if channel == 2 else [])


def test_before_the_first_usable_sample_nothing_is_predicted(bench, kernel):
    t, v, y, _ = motion(200)
    late_v, late_y = v.copy(), y.copy()
    late_y[:7] = np.nan
    late_v[:5] = np.nan
    model = preset("report-6", bench)
    block = OnlineFilter(model, kernel=kernel).process(t, late_v, late_y)
    assert_array_equal(block.ripple_nm[:8] + block.misalignment_nm[:8], np.zeros(8))
    shifted = OnlineFilter(model, kernel=kernel).process(t[5:], v[5:], late_y[5:])
    assert_array_equal(block.torque_filtered_nm[5:], shifted.torque_filtered_nm)


def test_a_lost_angle_is_carried_by_the_velocity_and_closed_by_the_next_one(kernel):
    t, v, y, angle = motion(800)
    with_holes = angle.copy()
    with_holes[300:310] = np.nan
    y[300:312] = np.nan
    whole = OnlineFilter(MODEL, kernel=kernel).process(t, v, y, angle)
    holed = OnlineFilter(MODEL, kernel=kernel).process(t, v, y, with_holes)
    # same total turn over the hole, so the same phase after it; P differs by how Q was turned
    assert_allclose(holed.torque_filtered_nm[312:], whole.torque_filtered_nm[312:], atol=1e-9)


def test_a_record_without_a_sample_is_left_alone(kernel):
    online = OnlineFilter(MODEL, kernel=kernel)
    block = online.process([], [], [])
    assert block.torque_filtered_nm.size == 0
    assert not online.state().any()


@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.003, 0.0])
def test_time_that_does_not_increase_is_refused_and_changes_nothing(kernel, bad):
    t = np.arange(10) * 1e-3
    online = OnlineFilter(MODEL, kernel=kernel)
    online.process(t[:4], t[:4], t[:4])
    before = online.state()
    later = t[4:].copy()
    later[3] = bad
    with pytest.raises(DataError, match=r"sample 3.*: time_s"):
        online.process(later, later, later)
    assert_array_equal(online.state(), before)
    with pytest.raises(DataError, match="time_s"):
        online.process(t[3:], t[3:], t[3:])
    assert_array_equal(online.state(), before)


def test_channels_of_different_length_are_refused(kernel):
    with pytest.raises(ValueError, match="torque_nm has shape \\(2,\\)"):
        OnlineFilter(MODEL, kernel=kernel).process([0.0], [0.0], [0.0, 1.0])
    with pytest.raises(ValueError, match="needed: 1 dimension"):
        OnlineFilter(MODEL, kernel=kernel).process([[0.0]], [0.0], [0.0])


def trace(**columns):
    t, v, y, _ = motion(300)
    return Trace({"time_s": t, "torque_nm": y, "motor_velocity_rad_s": v, **columns}, "here.csv")


def test_the_tacho_serves_where_there_is_no_velocity(bench):
    model = preset("report-6", bench)
    stored = trace()
    columns = dict(stored.columns)
    columns["tacho_v"] = columns.pop("motor_velocity_rad_s") / bench.tacho.gain_rad_s_per_v
    found = filter_trace(Trace(columns), model, bench)
    wanted = filter_trace(stored, model, bench)
    # one division and one product of rounding in the velocity
    assert_allclose(found.torque_filtered_nm, wanted.torque_filtered_nm, rtol=0.0, atol=1e-9)


def test_angle_or_encoder_serves_where_the_model_asks_for_it(bench):
    model = replace(preset("report-6", bench), use_measured_angle=True)
    count = np.round(np.linspace(0.0, 9000.0, 300))
    angle = count * (2.0 * np.pi / bench.encoder.counts_per_turn)
    by_angle = filter_trace(trace(motor_angle_rad=angle), model, bench)
    by_count = filter_trace(trace(encoder_count=count), model, bench)
    by_velocity = filter_trace(trace(), model, bench)
    assert_array_equal(by_angle.torque_filtered_nm, by_count.torque_filtered_nm)
    assert np.abs(by_angle.torque_filtered_nm - by_velocity.torque_filtered_nm).max() > 1e-3


@pytest.mark.parametrize("name", ["torque_nm", "motor_velocity_rad_s"])
def test_a_missing_channel_is_named(bench, name):
    columns = dict(trace().columns)
    del columns[name]
    with pytest.raises(DataError, match=rf"^here\.csv.*{name}"):
        filter_trace(Trace(columns, "here.csv"), preset("report-6", bench), bench)


def test_a_time_that_steps_back_names_file_and_sample(bench):
    stored = trace()
    stored.time_s[100] = stored.time_s[99]
    with pytest.raises(DataError, match=r"^here\.csv.*sample 100"):
        filter_trace(stored, preset("report-6", bench), bench)
