"""Online behaviour of tuned models: standstill, reversal, gaps, faults, amplitudes."""

from dataclasses import replace

import numpy as np
import pytest
from kernel_models import filter_model, order_block
from numpy.testing import assert_array_equal
from tuning_traces import GUARDED, tuned_like, turning

from hdbench.errors import DataError
from hdbench.filter import FilterModel, OnlineFilter, OscillatorBlock, SlowBlock
from hdbench.filter.online import block_amplitudes


def stop_and_go():
    """Turn for 30 s, stand for 30 s while the load changes twice, turn back for 30 s."""
    t = np.arange(90_000) * 1e-3
    v = np.where(t < 30.0, 100.0, np.where(t < 60.0, 0.0, -80.0))
    angle = np.concatenate([[0.0], np.cumsum(v[:-1] * 1e-3)])
    load = 5.0 + np.where(t > 40.0, 4.0, 0.0) - np.where(t > 50.0, 7.0, 0.0)
    misalignment = 3.0 * np.cos(angle / 100 + 0.7)
    y = load + misalignment + 1.2 * np.cos(2 * angle + 0.3) + 0.6 * np.cos(4 * angle + 1.0)
    return t, v, angle, y + np.random.default_rng(3).normal(0, 0.05, t.size), load, misalignment


def held_model():
    """Return a model whose offset moves a tenth of what the slow torque may at the output speed."""
    offset = SlowBlock("random-walk", noise_per_s=0.1)
    return replace(tuned_like(), slow=(offset, tuned_like().slow[1]))


def test_a_standing_motor_keeps_the_misalignment_while_the_load_changes():
    t, v, angle, y, load, misalignment = stop_and_go()
    online = OnlineFilter(held_model())
    block = online.process(t, v, y, angle)
    error = np.abs(block.misalignment_nm - misalignment)
    standing = (t > 30.0) & (t < 60.0)
    # 3 N m of misalignment, 4 and 7 N m of steps beside it
    assert error[standing].max() < 0.15
    assert error[t > 65.0].max() < 0.3
    assert np.sqrt(np.mean((block.torque_filtered_nm - load)[t > 65.0] ** 2)) < 0.15
    assert np.isfinite(online.state()).all()


def test_the_covariance_stays_bounded_and_positive_at_standstill(kernel):
    n = 3000 if kernel == "numpy" else 300_000
    online = OnlineFilter(tuned_like(), kernel=kernel)
    t = np.arange(n) * 1e-3
    y = np.random.default_rng(0).normal(2.0, 0.05, n)
    block = online.process(t, np.zeros(n), y)
    # R, three priors of 16 (N m)^2, the offset's 1600 and the resonance's 4: nothing is added to an
    # order while the motor stands
    variance = block.innovation_variance_nm2
    assert variance[0] <= 0.0025 + 3 * 16.0 + 1600.0 + 4.0 + 1e-9
    assert (variance > 0.0025).all()
    assert variance[-1] < 2.0 * variance[n // 2]
    assert np.isfinite(online.state()).all()


def test_a_gap_in_time_is_bridged_by_its_own_length():
    t, v, angle, y = turning(10.0, seed=1)
    keep = np.ones(t.size, bool)
    keep[4000:4500] = False
    cut = OnlineFilter(tuned_like()).process(t[keep], v[keep], y[keep], angle[keep])
    lost = y.copy()
    lost[~keep] = np.nan
    whole = OnlineFilter(tuned_like()).process(t, v, lost, angle)
    # noise per angle and per second grows with the gap, whether or not rows stand in it
    np.testing.assert_allclose(
        cut.torque_filtered_nm, whole.torque_filtered_nm[keep], rtol=0, atol=1e-6
    )


def test_saturated_and_stuck_samples_are_flagged_and_only_predict():
    t, v, angle, y = turning(6.0, seed=7)
    y[2000:2010] = 25.0 + np.arange(10)
    y[3000:3050] = y[3000]
    block = OnlineFilter(GUARDED).process(t, v, y, angle)
    assert_array_equal(np.flatnonzero(block.flags & 8), np.arange(2000, 2010))
    # from the fifth equal sample on
    assert_array_equal(np.flatnonzero(block.flags & 16), np.arange(3004, 3050))
    assert (block.flags[2000:2010] & 1).all()
    assert np.isnan(block.torque_filtered_nm[2000:2010]).all()
    lost = y.copy()
    lost[2000:2010] = lost[3004:3050] = np.nan
    wanted = OnlineFilter(tuned_like()).process(t, v, lost, angle)
    assert_array_equal(block.torque_filtered_nm, wanted.torque_filtered_nm)


def test_a_block_locked_to_the_clock_takes_its_tone():
    tone = OscillatorBlock(0.0, "ripple", 1e-6, "second", 50.0)
    model = filter_model((tone,), 0.0025, order_prior_std_nm=4.0)
    t, v, angle, _ = turning(4.0)
    y = 0.5 * np.cos(2 * np.pi * 50.0 * t + 0.3) + np.random.default_rng(0).normal(0, 0.05, t.size)
    left = OnlineFilter(model).process(t, v, y, angle).torque_filtered_nm[2000:]
    # the noise alone is left
    assert np.std(left) == pytest.approx(0.05, rel=0.05)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"torque_limit_nm": 0.0}, "torque_limit_nm"),
        ({"stuck_samples": 1}, "stuck_samples"),
        ({"gate_sigma": np.nan}, "gate_sigma"),
        ({"order_prior_std_nm": None}, "order_prior_std_nm"),
        ({"slow_prior_std_nm": None}, "slow_prior_std_nm"),
        ({"slow": GUARDED.slow * 8}, "blocks"),
    ],
)
def test_a_model_out_of_its_domain_is_refused(change, what):
    with pytest.raises(ValueError, match=what):
        replace(GUARDED, **change)


SWAY = {"kind": "resonance", "variance": 1.0, "frequency_hz": 1.0}


@pytest.mark.parametrize(
    ("fields", "what"),
    [
        ({"kind": "white"}, "kind"),
        ({"kind": "random-walk"}, "noise_per_s"),
        ({"kind": "random-walk", "noise_per_s": 1.0, "variance": 1.0}, "variance"),
        ({"kind": "ornstein-uhlenbeck", "variance": 1.0}, "time_constant_s"),
        ({**SWAY, "time_constant_s": 0.01}, "2 pi"),
    ],
)
def test_a_slow_block_out_of_its_domain_is_refused(fields, what):
    with pytest.raises(ValueError, match=what):
        SlowBlock(**fields)


TURNING = {"order": 1, "role": "ripple", "process_noise": 1}


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"slow": 3}, "slow"),
        ({"slow": [3]}, "slow.0"),
        ({"slow": [{"kind": "white"}]}, "slow.0"),
        ({"slow": [{"kind": "random-walk", "surplus": 1}]}, "slow.0"),
        ({"slow": [{"kind": "random-walk", "noise_per_s": "1"}]}, "noise_per_s"),
        ({"stuck_samples": 2.5}, "stuck_samples"),
        ({"gate_sigma": "6"}, "gate_sigma"),
        ({"tuning": []}, "tuning"),
        ({"blocks": [{**TURNING, "noise_per": "turn"}]}, "noise_per"),
    ],
)
def test_a_bad_key_of_a_tuned_model_file_names_the_place(change, place):
    with pytest.raises(DataError, match=place):
        FilterModel.from_dict({**GUARDED.to_dict(), **change}, source="bad.json")
    assert FilterModel.from_dict(GUARDED.to_dict()) == GUARDED


MODEL = filter_model(
    (order_block(2.0, 1e-7), order_block(4.0, 1e-7)),
    0.05**2,
    angle=True,
    slow=(SlowBlock("random-walk", noise_per_s=1e-3),),
    order_prior_std_nm=2.0,
    slow_prior_std_nm=1.0,
)


@pytest.mark.parametrize("seed", range(4))
def test_amplitudes_are_those_of_the_signal_within_their_own_uncertainty(seed):
    rng = np.random.default_rng(seed)
    time = np.arange(8000) * 1e-3
    velocity = 100.0 + 30.0 * np.sin(0.7 * time)
    angle = np.cumsum(velocity) * 1e-3
    second, fourth = rng.uniform(0.5, 1.5), rng.uniform(0.2, 0.6)
    torque = second * np.cos(2 * angle + 1.0) + fourth * np.cos(4 * angle - 2.0)
    online = OnlineFilter(MODEL)
    online.process(time, velocity, torque + 0.05 * rng.standard_normal(8000), angle)
    found = block_amplitudes(MODEL, online.state())
    assert [a.block.order for a in found] == [2.0, 4.0]
    for amplitude, truth in zip(found, (second, fourth), strict=True):
        # 5 sigma: a chance of 6e-7 each that a right filter fails here
        assert abs(amplitude.amplitude_nm - truth) < 5.0 * amplitude.std_nm
        # 8000 samples of 0.05 N m fix an amplitude to 0.05 sqrt(2 / 8000) if nothing changed;
        # the walk of the states leaves less than a fifth of the noise
        assert 0.05 * np.sqrt(2 / 8000) < amplitude.std_nm < 0.01
