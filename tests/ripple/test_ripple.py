"""Torque ripple of free-motion runs."""

import math

import numpy as np
import pytest
from changing import with_keys
from known_traces import Truth, bench, covers, drawn_runs, known_trace, reversing_velocity, scale
from publicdata import DATA, needs_data
from scipy.stats import binom

from hdbench.errors import DataError
from hdbench.filter import filter_trace, preset
from hdbench.records import Quantity, TorqueScale, Trace
from hdbench.results import RippleResult
from hdbench.ripple import Stretch, evaluate_ripple

BENCH = bench()
FILTER = preset("report-6", BENCH)


def short_trace(seed: int) -> Trace:
    """Return three seconds through reversals."""
    return known_trace(np.random.default_rng(seed), reversing_velocity(3.0))


def evaluate(trace: Trace, *, stretch: Stretch | None = None) -> RippleResult:
    return evaluate_ripple(trace, BENCH, scale=scale(), filter_model=FILTER, stretch=stretch)


@pytest.fixture(scope="module")
def reversals():
    """Return results of runs through reversals, in white noise and in coloured noise."""
    return {
        colour: evaluate(known_trace(np.random.default_rng(1), reversing_velocity(), colour=colour))
        for colour in (0.0, 0.9)
    }


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_amplitudes_and_phases_are_found_through_reversals(colour, reversals):
    found = reversals[colour]
    # 99.9 % intervals of four numbers: false alarm 0.4 %
    for entry, (amplitude, phase) in zip(found.ripple, ((0.4, 0.6), (0.2, -1.1)), strict=True):
        assert covers(entry.amplitude_nm, amplitude)
        assert covers(entry.phase_rad, phase)
    assert (*found.lines, *found.tones) == ()


@pytest.mark.parametrize("n_runs", [12, pytest.param(24, marks=pytest.mark.campaign)])
def test_intervals_cover_the_truth_with_a_gain_of_three_dof(n_runs):
    velocity, hits = reversing_velocity(3.0), np.zeros(4)
    for true_gain, gain, trace in drawn_runs(velocity, n_runs):
        found = evaluate_ripple(trace, BENCH, scale=gain, filter_model=FILTER)
        truth = (0.4 * true_gain / 6.6, 0.2 * true_gain / 6.6, 0.6, -1.1)
        two, four = found.ripple
        numbers = (two.amplitude_nm, four.amplitude_nm, two.phase_rad, four.phase_rad)
        hits += [covers(q, x, 0.95) for q, x in zip(numbers, truth, strict=True)]
    # four counts, each at least binomial(n_runs, 0.95); false alarm 4 x 2.5e-4 = 1e-3
    assert np.all(hits >= binom.ppf(2.5e-4, n_runs, 0.95)), hits


def test_an_order_is_measured(reversals):
    for entry in reversals[0.0].ripple:
        assert covers(entry.order_estimate, entry.order)
        # Cramer-Rao: sqrt(6 / n) 2 sigma / (A range), range 460 rad; half of it or twice for the
        # shape of the motion
        bound = 2.0 * math.sqrt(6.0 / 12_000) * 0.05 / entry.amplitude_nm.value / 460.0
        assert 0.4 * bound < entry.order_estimate.std < 2.5 * bound


def test_a_hidden_order_and_a_tone_are_listed_where_they_are():
    rng = np.random.default_rng(3)
    velocity = reversing_velocity()
    angle = np.concatenate([[0.0], np.cumsum(velocity[:-1] * 0.001)])
    time = np.arange(len(velocity)) * 0.001
    extra = 0.1 * np.cos(7.37 * angle + 1.0) + 0.05 * np.cos(2.0 * np.pi * 50.02 * time + 0.3)
    body = evaluate(known_trace(rng, velocity, extra_nm=extra)).to_json()
    assert len(body["lines"]) == 1
    assert len(body["tones"]) == 1
    # a hundredth of the resolution 1 / 73 turns and 1 / 12 s
    assert body["lines"][0]["order"] == pytest.approx(7.37, abs=1.4e-3)
    assert body["tones"][0]["frequency_hz"] == pytest.approx(50.02, abs=8e-3)
    assert covers(Quantity(**body["lines"][0]["amplitude_nm"]), 0.1)
    assert covers(Quantity(**body["ripple"][0]["amplitude_nm"]), 0.4)


def test_clean_runs_seldom_list_a_line():
    velocity = reversing_velocity(3.0)
    listed = 0
    for seed in range(16):
        trace = known_trace(np.random.default_rng(seed), velocity, colour=0.9 * (seed % 2))
        found = evaluate(trace)
        listed += len(found.lines) + len(found.tones)
    # level 1e-3 per run: one by chance in 16 runs has 1.6 %, two 0.01 %
    assert listed <= 1


def test_friction_gravity_and_drift_are_carried_as_slow_terms():
    rng = np.random.default_rng(4)
    velocity = reversing_velocity()
    time = np.arange(len(velocity)) * 0.001
    extra = 0.5 * np.tanh(velocity / 3.0) + 0.02 * time**2
    found = evaluate(known_trace(rng, velocity, extra_nm=extra))
    assert found.trend.direction_offset
    assert found.trend.degree >= 2
    assert covers(found.ripple[0].amplitude_nm, 0.4)
    assert covers(found.ripple[1].amplitude_nm, 0.2)


def test_peaks_of_the_steady_spectrum_are_named_at_twice_and_four_times_the_velocity(reversals):
    found = reversals[0.0].spectrum
    # tacho noise averaged, and ends of the stretch inside the rounded corners
    assert abs(found.motor_velocity_rad_s) == pytest.approx(156.0, rel=2e-3)
    named = {peak.name: peak for peak in found.peaks}
    for name, order, amplitude in (("2x", 2.0, 0.4), ("4x", 4.0, 0.2)):
        # grid of an eighth of the resolution 0.4 Hz, and the smear of the velocity
        assert named[name].angular_frequency_rad_s == pytest.approx(order * 156.0, rel=5e-3)
        # scalloping 1 %, smear and noise
        assert named[name].amplitude_nm == pytest.approx(amplitude, rel=0.05)
    assert set(named) == {"2x", "4x"}


def test_suppression_is_the_ratio_of_the_components_before_and_after_the_filter():
    velocity, model = np.full(9000, 100.0), preset("report-a2", BENCH)
    trace = known_trace(np.random.default_rng(6), velocity)
    found = evaluate_ripple(
        trace, BENCH, scale=scale(), filter_model=model, stretch=Stretch(from_s=2.0)
    )
    torque = 6.6 * trace["torque_v"]
    filtered = filter_trace(trace.with_columns(torque_nm=torque), model, BENCH).torque_filtered_nm
    # 6912 samples hold 440 cycles of 400 rad/s to 3e-3 of one: plain demodulation
    part = slice(2000, 2000 + round(440 * 2.0 * np.pi / 400.0 / 0.001))
    turn = np.exp(-4j * trace["motor_angle_rad"][part])
    ratio = abs(np.mean(torque[part] * turn)) / abs(np.mean(filtered[part] * turn))
    two, four = found.ripple
    # noise of 1 mN m on what is left, at least 50 mN m: 0.2 dB; three of them
    assert four.suppression_db == pytest.approx(20.0 * math.log10(ratio), abs=0.6)
    # this model has a zero at order 2
    assert two.suppression_db > 30.0
    assert found.torque_rms_nm.filtered < found.torque_rms_nm.measured


def test_the_stretch_chooses_samples_by_velocity_and_time():
    trace = known_trace(np.random.default_rng(7), reversing_velocity())
    fast = evaluate(trace, stretch=Stretch(velocity_above_rad_s=150.0, from_s=0.2, to_s=2.9))
    assert fast.motor_velocity_rad_s.min > 150.0
    assert fast.evaluated.from_s >= 0.2
    assert fast.evaluated.to_s <= 2.9
    assert covers(fast.ripple[0].amplitude_nm, 0.4)


def test_lost_samples_are_left_out_and_marked():
    trace = known_trace(np.random.default_rng(8), reversing_velocity())
    lost = np.zeros(len(trace), dtype=bool)
    lost[5000:5100] = True
    lost[777] = True
    broken = Trace(
        {k: c if k == "time_s" else np.where(lost, np.nan, c) for k, c in trace.columns.items()}
    )
    found = evaluate(broken)
    assert [(flag.name, flag.samples) for flag in found.flags] == [("missing-samples", 101)]
    assert covers(found.ripple[0].amplitude_nm, 0.4)


def test_a_saturated_channel_is_marked():
    trace = short_trace(9)
    clipped = trace.with_columns(torque_v=np.clip(trace["torque_v"] + 9.95, -10.0, 10.0))
    assert [flag.name for flag in evaluate(clipped).flags] == ["saturation"]


def test_a_gain_of_half_gives_half_the_torque():
    half = TorqueScale(Quantity(3.3, 0.0), "calibration run 2")
    found = evaluate_ripple(short_trace(10), BENCH, scale=half, filter_model=FILTER)
    assert covers(found.ripple[0].amplitude_nm, 0.2)
    assert found.to_json()["torque_scale"]["gain_nm_per_v"]["value"] == 3.3


def test_the_rms_of_the_torque_counts_its_mean():
    trace = short_trace(10)
    shifted = trace.with_columns(torque_nm=6.6 * trace["torque_v"] + 3.0)
    found = evaluate(shifted)
    rms = math.sqrt(np.mean(np.square(shifted["torque_nm"])))
    assert rms > 2.0 * np.std(shifted["torque_nm"])
    assert found.torque_rms_nm.measured == pytest.approx(rms, rel=1e-12)


def test_a_torque_column_in_newton_metres_is_taken_as_it_stands():
    trace = short_trace(10)
    found = evaluate(trace.with_columns(torque_nm=2.0 * 6.6 * trace["torque_v"]))
    assert covers(found.ripple[0].amplitude_nm, 0.8)


def test_orders_and_noise_are_told_to_the_filter():
    found = evaluate(short_trace(11))
    assert [entry.order for entry in found.suppression_db] == [2.0, 4.0]
    assert found.filter.orders == (2.0, 4.0)
    # white noise of 0.05 N m, known to 1.3 % from 3000 samples; steps of the converter add 2 mN m
    assert found.noise_std_nm == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize(
    ("velocity", "text"), [(0.0, "0 cycles of order 2"), (0.5, "needed: at least 2")]
)
def test_a_motor_that_hardly_turns_is_refused(velocity, text):
    trace = known_trace(np.random.default_rng(12), np.full(3000, velocity))
    with pytest.raises(DataError, match=text):
        evaluate(trace)


def lara8(*, encoder: bool) -> Trace:
    path = DATA / "lara8_dual_encoder" / "validate_joint3_sweep.csv"
    rows = np.genfromtxt(path, delimiter=",", names=True)
    columns = {
        "time_s": rows["Timestamp"] - rows["Timestamp"][0],
        "motor_velocity_rad_s": 101.0 * rows["joint_velocity_3"],
        "torque_nm": rows["joint_torque_current_3"],
    }
    if encoder:
        columns["motor_angle_rad"] = rows["encoder_motorinc_3"] * 2.0 * np.pi / 2.0**24
    return Trace(columns, str(path))


@needs_data
@pytest.mark.parametrize("encoder", [True, False])
def test_joint_sweep_of_another_drive_shows_order_2_and_the_line_near_7_9(encoder):
    profile = bench(gear_ratio=101.0)
    found = evaluate_ripple(
        lara8(encoder=encoder),
        profile,
        scale=TorqueScale(Quantity(1.0, 0.0), "trace torque_nm column"),
        filter_model=preset("report-6", profile),
        stretch=Stretch(velocity_above_rad_s=0.86 * 101.0),
    )
    two = found.ripple[0]
    # known of this record: order 2.00 +- 0.01, 0.56 +- 0.06 N m, a line near order 7.90
    assert two.order_estimate.value == pytest.approx(2.0, abs=0.01)
    assert two.amplitude_nm.value == pytest.approx(0.56, abs=0.06)
    near = [x for x in found.lines if abs(x.order - 7.9) < 0.02]
    assert len(near) == 1
    assert near[0].false_alarm_probability < 1e-3


def test_truth_of_the_traces_is_the_models():
    assert Truth().order_2 == (BENCH.model.ripple[0].amplitude_nm, BENCH.model.ripple[0].phase_rad)


def test_a_turning_flexspline_is_evaluated_at_the_orders_its_gauges_see():
    turning = with_keys(BENCH, drive={"flexspline": "turning"})
    rng = np.random.default_rng(7)
    time_s = np.arange(20_000) * 1e-3
    angle = 100.0 * time_s
    torque = 0.4 * np.cos(2.02 * angle + 0.3) + 0.2 * np.cos(4.04 * angle - 1.0)
    noisy = torque + 0.05 * rng.standard_normal(20_000)
    motion = {"motor_velocity_rad_s": np.full(20_000, 100.0), "motor_angle_rad": angle}
    trace = Trace({"time_s": time_s, **motion, "torque_nm": noisy})
    scale = TorqueScale(Quantity(1.0, 0.0), "as given")
    result = evaluate_ripple(trace, turning, scale=scale, filter_model=preset("report-6", turning))
    assert [line.order for line in result.ripple] == pytest.approx([2.02, 4.04], rel=1e-12)
    # five standard errors of an amplitude: 0.05 sqrt(2 / 20000) = 0.5 mN m each
    assert result.ripple[0].amplitude_nm.value == pytest.approx(0.4, abs=2.5e-3)
    assert result.ripple[1].amplitude_nm.value == pytest.approx(0.2, abs=2.5e-3)
    assert (*result.lines, *result.tones) == ()
