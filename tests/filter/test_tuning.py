"""Tuning: noise by maximum likelihood, and what it says when the data are silent."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import tuning_campaign
from kernel_models import filter_model, new_state, order_block, run
from numpy.testing import assert_allclose
from tuning_traces import channels, needs_compiled_kernel, recorded, turning

from hdbench.errors import DataError
from hdbench.filter import (
    OnlineFilter,
    SlowBlock,
    load_filter_model,
    preset,
    transfer_at_steady_speed,
    tune,
)
from hdbench.filter.response import filter_response
from hdbench.filter.tuning import limits
from hdbench.filter.tuning.problem import TuningSettings, describe_motion, scaled, score
from hdbench.filter.tuning.result import Estimate, check_innovations, ljung_box, nis_band
from hdbench.filter.tuning.run import settings_of
from hdbench.filter.tuning.search import curvature

SETTINGS = TuningSettings(4.0, 40.0)


def relative_model(slow):
    blocks = (order_block(2.0, 1e-6), order_block(0.01, 1e-5, "misalignment"))
    prior = {"order_prior_std_nm": 20.0, "slow_prior_std_nm": 50.0}
    return filter_model(blocks, 1.0, angle=True, slow=slow, **prior)


SLOW = [
    SlowBlock("random-walk", noise_per_s=3.0),
    SlowBlock("ornstein-uhlenbeck", variance=200.0, time_constant_s=0.1),
    SlowBlock("matern-3/2", variance=200.0, time_constant_s=0.1),
    SlowBlock("resonance", variance=200.0, time_constant_s=0.3, frequency_hz=2.0),
]


@pytest.mark.parametrize("block", SLOW, ids=lambda block: block.kind)
def test_the_score_is_the_likelihood_with_all_noise_scaled_to_the_data(block):
    needs_compiled_kernel()
    t, v, angle, y = turning(1.2, seed=2)
    t = t + 2e-4 * np.sin(np.arange(t.size))  # uneven sampling
    y[100:130] = np.nan
    model = relative_model((block,))
    found = score(model, [channels(t, v, y, angle)])
    absolute = scaled(model, found.noise_nm2)
    # the likelihood of a filter is held against statsmodels in test_kernel_properties
    wanted = run(absolute, new_state(absolute), t, v, y, angle_rad=angle)
    assert found.samples == wanted.n_used == np.isfinite(y).sum()
    # 1e-8: agreement asked of two ways to one likelihood; rounding of 1200 samples is below
    assert found.log_likelihood == pytest.approx(wanted.log_likelihood, rel=1e-8)


def test_two_traces_count_as_independent_records():
    model = relative_model((SLOW[1],))
    records = [recorded(1.0, seed=s) for s in (1, 2)]
    single = [score(model, [record]) for record in records]
    both = score(model, records)
    assert both.samples == sum(s.samples for s in single)
    total = sum(s.samples * s.noise_nm2 for s in single)
    # the mean of all normalised squares: one division
    assert both.noise_nm2 == pytest.approx(total / both.samples, rel=1e-12)


@pytest.fixture(scope="module")
def base(bench):
    """Return the model of six states that is tuned."""
    needs_compiled_kernel()
    return replace(preset("report-6", bench), load_inertia_kg_m2=0.0, use_measured_angle=True)


@pytest.fixture(scope="module")
def tuned(base, bench):
    """Return one tuning with its trace: first-order torque beside ripple and misalignment."""
    record = recorded(10.0, seed=5)
    return record, tune(base, [record], settings_of(bench), origins={"trace": "sha256 0"})


def test_the_noise_that_was_put_in_is_found_within_its_standard_errors(tuned):
    _, found = tuned
    by_name = {e.name: e for e in found.estimates}
    assert found.candidates[0].slow == "ornstein-uhlenbeck"
    assert found.converged
    for name, truth in (
        ("measurement_noise", 0.05**2),
        ("ornstein-uhlenbeck variance", 0.25),
        ("ornstein-uhlenbeck time_constant_s", 0.1),
    ):
        estimate = by_name[name]
        # three standard errors, and the noise of R that a filter's own gain adds to it
        spread = 3.0 * max(estimate.relative_std, 0.02)
        assert abs(math.log(estimate.value / truth)) < spread, name


def test_the_innovations_of_a_tuned_model_are_white_and_of_their_variance(tuned):
    _, found = tuned
    check = found.consistency
    assert check.nis.band[0] < check.nis.value < check.nis.band[1]
    # a right model fails this once in ten thousand traces
    assert check.whiteness.p_value > 1e-4
    assert abs(check.whiteness.largest_autocorrelation) < 0.05


def test_an_untuned_model_fails_the_same_checks(tuned, bench):
    record, found = tuned
    wrong = replace(found.model, measurement_noise=4.0 * found.model.measurement_noise)
    check = check_innovations(wrong, [record])
    assert not check.nis.band[0] < check.nis.value < check.nis.band[1]
    assert check.whiteness.p_value < 1e-6


def test_the_tuned_model_is_stored_and_read_back(tuned, bench, tmp_path):
    record, found = tuned
    file = tmp_path / "tuned.json"
    file.write_text(json.dumps(found.model.to_dict(), allow_nan=False))
    read = load_filter_model(str(file), bench)
    assert read == found.model
    assert read.provenance["trace"] == "sha256 0"
    assert read.tuning["consistency"]["nis"]["value"] == found.consistency.nis.value
    once = OnlineFilter(found.model).process(*_args(record)).torque_filtered_nm
    again = OnlineFilter(read).process(*_args(record)).torque_filtered_nm
    assert np.array_equal(once, again)


def _args(record):
    return record.time_s, record.velocity_rad_s, record.torque_nm, record.angle_rad


def beginning(record, n):
    return channels(*(column[:n] for column in _args(record)))


def tuned_with(base, record, slow, scale=1.0):
    return tune(base, [record], TuningSettings(4.0 * scale, 40.0 * scale, slow=slow))


def test_torque_in_other_units_scales_every_noise(base, tuned):
    cut = beginning(tuned[0], 3000)
    eightfold = replace(cut, torque_nm=8.0 * cut.torque_nm)
    one = tuned_with(base, cut, "ornstein-uhlenbeck")
    ten = tuned_with(base, eightfold, "ornstein-uhlenbeck", scale=8.0)
    # a power of two scales exactly, so the search takes the same steps up to rounding
    for a, b in zip(one.estimates, ten.estimates, strict=True):
        factor = 64.0 if a.unit.startswith("(N m)^2") else 1.0
        assert b.value == pytest.approx(factor * a.value, rel=1e-3), a.name


def test_a_tuned_filter_keeps_the_torque_and_takes_the_ripple(bench):
    """Reduced form of tools/tuning_campaign.py: one seed, shorter traces."""
    needs_compiled_kernel()
    scenario = tuning_campaign.SCENARIOS["2 Hz low-pass noise"]
    row = tuning_campaign.one(scenario, 3, 22.0)
    assert row["converged"]
    assert row["ratio"] <= 1.35
    assert min(row["suppression_db"]) >= 30.0
    assert row["noise_gain"] <= 1.05
    assert row["gain_least"] >= 0.98
    assert row["gain_most"] <= 1.02
    # the oracle itself must be one: far better than the report's tuning
    assert row["oracle_error_nm"] < 0.3 * row["report_error_nm"]


def test_a_walk_by_name_is_warned_of_and_a_stationary_kind_is_what_auto_takes(base, tuned):
    record, found = tuned
    assert {c.slow for c in found.candidates} == {"none", "ornstein-uhlenbeck", "resonance"}
    walk = tuned_with(base, beginning(record, 2000), "integrated-random-walk")
    assert any("unbounded variance" in note for note in walk.notes)
    assert walk.model.slow[0].kind == "integrated-random-walk"


def test_few_output_turns_and_constant_speed_are_told(base):
    record = recorded(2.5, seed=1, low=60.0, high=60.0)
    notes = tuned_with(base, record, "ornstein-uhlenbeck").notes
    assert any("output turns" in note and "order 0.01" in note for note in notes)
    assert any("constant speed" in note for note in notes)


def test_an_order_that_the_model_lacks_is_noticed_in_the_innovations(base):
    t, v, angle, y = turning(3.0, seed=1)
    record = channels(t, v, y + 0.5 * np.cos(6 * angle), angle)
    notes = tuned_with(base, record, "random-walk").notes
    assert any("not white" in note and "--order" in note for note in notes)


def test_a_resonance_at_an_order_of_a_constant_speed_is_refused():
    slow = SlowBlock("resonance", variance=1.0, time_constant_s=5.0, frequency_hz=0.1)
    model = relative_model((slow,))
    steady = describe_motion([recorded(4.0, low=60.0, high=60.0)])
    swinging = describe_motion([recorded(4.0)])
    # order 0.01 at 60 rad/s turns at 0.095 Hz
    assert "order 0.01" in limits.refusal(model, steady)
    assert limits.refusal(model, swinging) is None


def test_spikes_are_left_out_and_a_step_is_not(base):
    t, v, angle, y = turning(2.5, seed=4)
    y[1400:] += 3.0
    spiky = y.copy()
    spikes = np.array([600, 1222, 1701, 2303])
    spiky[spikes] += 4.0
    clean, found = (
        tuned_with(base, channels(t, v, torque, angle), "ornstein-uhlenbeck")
        for torque in (y, spiky)
    )
    assert clean.outliers == 0
    assert found.outliers == spikes.size
    flags = OnlineFilter(found.model).process(t, v, spiky, angle).flags
    assert (flags[spikes] & 2).all()


@pytest.mark.parametrize(
    ("records", "what"),
    [
        ([], "no trace"),
        ([recorded(1.0)], "samples"),
        ([channels(*turning(3.0)[:2], np.zeros(3000))], "no noise"),
    ],
    ids=["none", "short", "silent"],
)
def test_traces_that_say_nothing_are_refused(bench, records, what):
    with pytest.raises(DataError, match=what):
        tune(preset("report-6", bench), records, SETTINGS)


@pytest.mark.parametrize(
    "change",
    [
        {"order_prior_std_nm": math.nan},
        {"slow_prior_std_nm": 0.0},
        {"slow": "white"},
        {"gate_sigma": 2.0},
        {"torque_limit_nm": -1.0},
        {"max_evaluations": 3},
    ],
)
def test_settings_out_of_their_domain_are_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        replace(SETTINGS, **change)


def test_the_band_of_the_normalised_squares_is_chi_square():
    from scipy.stats import chi2

    for n in (1, 10, 60_000):
        # two routes to one quantile
        assert_allclose(nis_band(n), chi2.ppf([0.025, 0.975], n) / n, rtol=1e-9)


def test_the_whiteness_test_is_that_of_statsmodels():
    from statsmodels.stats.diagnostic import acorr_ljungbox

    x = np.random.default_rng(1).normal(size=3000)
    x[1:] += 0.05 * x[:-1]
    statistic, p_value, _ = ljung_box(x, 20)
    wanted = acorr_ljungbox(x, lags=[20])
    # both sum the same products in another order
    assert statistic == pytest.approx(float(wanted["lb_stat"].iloc[0]), rel=1e-9)
    assert p_value == pytest.approx(float(wanted["lb_pvalue"].iloc[0]), rel=1e-9)


def test_the_curvature_of_a_parabola_is_its_matrix():
    matrix = np.array([[4.0, 1.0], [1.0, 900.0]])
    centre = np.array([0.3, -1.0])
    found = curvature(centre, lambda x: -0.5 * float((x - centre) @ matrix @ (x - centre)))
    # differences of a parabola are exact but for rounding
    assert_allclose(found, matrix, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("block", SLOW, ids=lambda block: block.kind)
def test_the_density_of_a_slow_torque_integrates_to_its_variance(block):
    if not block.stationary:
        # a random walk of q has q / w^2: ten times the frequency, a hundredth
        assert limits.slow_density(block, 1.0) == pytest.approx(
            100.0 * limits.slow_density(block, 10.0)
        )
        return
    hz = np.concatenate([np.linspace(1e-4, 20.0, 20_001), np.geomspace(20.0, 1e6, 4000)[1:]])
    density = np.array([limits.slow_density(block, f) for f in hz])
    total = 2.0 * float(np.trapezoid(density, hz))
    # the trapezoid's steps, and what lies above 1e6 Hz
    assert total == pytest.approx(block.variance, rel=5e-3)


def test_an_order_without_a_peak_forgets_within_the_traces_and_leaves_the_torque_alone():
    motion = describe_motion([recorded(20.0)])
    found = [
        Estimate("measurement_noise", "(N m)^2", 0.0025, 0.01),
        Estimate("order 2 process_noise", "(N m)^2/rad", 1e-20, None),
        Estimate("order 0.01 process_noise", "(N m)^2/rad", 1e-4, 0.3),
    ]
    blocks = (order_block(2.0, 1e-20), order_block(0.01, 1e-4, "misalignment"))
    model = replace(relative_model(()), blocks=blocks, measurement_noise=0.0025)
    raised, estimates = limits.forget_beyond_the_data(model, found, motion)
    assert estimates[1].held
    assert not estimates[2].held
    # a number with a peak is what the data say
    assert raised.blocks[1].process_noise == 1e-4
    alone = replace(raised, blocks=raised.blocks[:1])
    mode = filter_response(alone, motion.speed_rad_s, 1e-3).settling_time_s / math.log(50.0)
    # P^2 / (2 S) = q gives a decay of 1/duration; the speed swings about its mean
    assert mode == pytest.approx(20.0, rel=0.1)


@pytest.mark.parametrize(("noise", "lowered"), [(1e-7, False), (2e-4, True)])
def test_misalignment_is_not_given_the_torque_that_the_slow_block_does_not_fit(noise, lowered):
    motion = describe_motion([recorded(40.0)])
    slow = SlowBlock("resonance", variance=3.0, time_constant_s=0.1, frequency_hz=2.9)
    blocks = (order_block(2.0, 1e-6), order_block(0.01, noise, "misalignment"))
    model = replace(relative_model((slow,)), blocks=blocks, measurement_noise=0.0032)
    found = [Estimate(name, "", 1.0, None) for name in ("R", "order 2", "order 0.01")]
    kept, estimates = limits.leave_the_torque(model, found, motion)
    assert [one.lowered for one in estimates] == [False, False, lowered]
    assert kept.blocks[0] == model.blocks[0]
    if not lowered:
        assert kept == model
        return
    hz = np.geomspace(0.5, 10.0, 60)

    def least(of):
        return np.abs(transfer_at_steady_speed(of, motion.fastest_rad_s, 1e-3, hz)).min()

    assert least(model) < 0.97
    assert least(kept) > 0.98
    # no less than a memory of the traces' length: 2 S / angle^2 at the noise's density alone
    memory = 2.0 * 0.0032e-3 * motion.speed_rad_s / motion.turned_rad**2
    assert kept.blocks[1].process_noise > memory


def test_the_offset_has_a_tenth_of_the_density_at_the_slowest_order():
    motion = describe_motion([recorded(20.0)])
    slow = (SlowBlock("random-walk", noise_per_s=1e-9), SLOW[1])
    moved = limits.with_moving_offset(relative_model(slow), motion)
    hz = 0.01 * motion.speed_rad_s / (2.0 * math.pi)
    others = motion.period_s + limits.slow_density(slow[1], hz)
    assert limits.slow_density(moved.slow[0], hz) == pytest.approx(0.1 * others)
    assert moved.slow[1] == slow[1]
