"""Arm, weights and gain by position against statics and probability."""

import math

import numpy as np
import pytest
from plant_tools import AS_MODELLED, V_PER_CODE, plant, profile, quiet_profile, run
from scipy.stats import chi2

from hdbench.plant.bench import SimulatedBench
from hdbench.plant.fixture import ArmLoad, PositionGain
from hdbench.plant.plantfile import FixtureSpec


def _reading_v(bench: SimulatedBench, position: float, mass: float, direction: int) -> float:
    """Return the mean of half a second, four seconds after the weight was hung."""
    bench.set_fixture(locked=True, position_rad=position, mass_kg=mass, direction=direction)
    return float(run(bench, None, 450, 0.01).torque_code[400:].mean()) * V_PER_CODE


@pytest.mark.parametrize("positions", [2, 3, 4, 6, 8])
def test_gains_at_equally_spaced_positions_are_independent_standard_normal(positions):
    n = 400
    angles = [2 * math.pi * k / positions for k in range(positions)]
    drawn = (PositionGain.draw(1.0, 1.0, np.random.default_rng(seed)) for seed in range(n))
    gains = np.array([[gain.at(a) - 1.0 for a in angles] for gain in drawn])
    # chi-square of all values with mean 0 and std 1: false alarm 1e-6 on either side
    total = float((gains**2).sum())
    assert chi2.ppf(1e-6, gains.size) < total < chi2.ppf(1 - 1e-6, gains.size)
    # correlations have std 1/sqrt(400): five of them, false alarm below 28 pairs * 6e-7
    correlation = np.corrcoef(gains.T)[np.triu_indices(positions, 1)]
    assert np.abs(correlation).max() < 5.0 / math.sqrt(n)
    # so has the mean at every position
    assert np.abs(gains.mean(axis=0)).max() < 5.0 / math.sqrt(n)


def test_gain_averages_to_the_true_gain_over_the_turn():
    gain = PositionGain.draw(6.6, 0.02, np.random.default_rng(5))
    turn = [gain.at(a) for a in np.arange(360) * (2 * math.pi / 360)]
    # a sum over 360 points of harmonics up to 24 is exact but for rounding
    assert np.mean(turn) == pytest.approx(6.6, rel=1e-14)


def test_readings_have_the_gain_of_their_position():
    bench = SimulatedBench(quiet_profile(), plant(fixture={"repeatability": 0.0}), 7)
    truth = dict(bench.truth()["gain_at_position"])  # type: ignore[call-overload]
    for position in (0.0, math.pi / 2, math.pi):
        readings = [_reading_v(bench, position, mass, 1) for mass in (0.0, 8.0)]
        torque = 8.0 * 9.8065 * 0.5
        slope = torque / (readings[1] - readings[0])
        # without noise a reading is off by up to half a code, here one of 19 000 for both together;
        # the swing has left 39 N m * (0.035 e^-4)^2 = 0.02 mN m
        assert slope == pytest.approx(truth[position], rel=6e-5)


def test_zero_at_a_position_is_the_ripple_there():
    bench = SimulatedBench(quiet_profile(), AS_MODELLED, 7)
    for position in (0.0, 0.4, 1.1):
        reading = _reading_v(bench, position, 0.0, 1)
        expected = 0.4 * math.cos(-2 * position + 0.6) + 0.2 * math.cos(-4 * position - 1.1)
        # half a code of 2 mN m
        assert reading * 6.6 == pytest.approx(expected, abs=1.1e-3)


def test_ccw_turns_the_sign():
    bench = SimulatedBench(quiet_profile(), AS_MODELLED, 7)
    zero = _reading_v(bench, 0.0, 0.0, 1)
    cw, ccw = (_reading_v(bench, 0.0, 4.0, direction) - zero for direction in (1, -1))
    assert cw > 0.0
    # two clampings: five sigma of sqrt(2) * 5e-4, and a code
    assert cw == pytest.approx(-ccw, rel=4e-3)


def test_encoder_stands_still_while_locked():
    bench = SimulatedBench(profile(), AS_MODELLED, 7)
    bench.set_fixture(locked=True, position_rad=0.3, mass_kg=8.0, direction=1)
    samples = run(bench, profile().ripple.reference, 100, 0.01)
    assert not samples.encoder_count.any()
    assert bench.velocity_rad_s == 0.0


def test_a_weight_settles_within_seconds_and_starts_where_the_old_one_was():
    load = ArmLoad(10.0, 40.0, 9.8065, FixtureSpec())
    age = np.linspace(-1.0, 5.0, 6001)
    torque = load.torque_nm(age)
    assert np.all(torque[age < 0] == 10.0)
    # at the moment of the change only the swing of 40 N m * 0.035^2 is there
    assert load.torque_nm(np.zeros(1))[0] == pytest.approx(10.0 + 40 * 0.035**2, rel=1e-12)
    # 20 mN m, the settle band of the profile
    assert np.abs(torque[age > 2.5] - 40.0).max() < 0.02
    assert np.abs(torque[(age > 0) & (age < 0.05)] - 40.0).max() > 10.0


def test_bounce_has_its_frequency_and_decay():
    still = FixtureSpec(swing_rad=0.0)
    age = np.linspace(0.0, 1.0, 100_001)
    away = ArmLoad(0.0, 1.0, 9.8065, still).torque_nm(age) - 1.0
    tops = np.flatnonzero((away[1:-1] > away[:-2]) & (away[1:-1] > away[2:])) + 1
    # second-order step response: extremes lie one damped period apart, on a grid of 10 us
    damped = 12.0 * math.sqrt(1 - 0.05**2)
    assert np.diff(age[tops]) == pytest.approx(1 / damped, abs=2e-5)
    ratio = away[tops[1]] / away[tops[0]]
    assert ratio == pytest.approx(math.exp(-2 * math.pi * 0.05 / math.sqrt(1 - 0.05**2)), rel=1e-4)


def test_one_clamping_repeats_within_the_plant_files_share():
    spread = 0.01
    same_everywhere = quiet_profile(sensor={"gain_consistency": 0.0})
    spec = plant(fixture={"repeatability": spread})
    found = []
    for seed in range(200):
        bench = SimulatedBench(same_everywhere, spec, seed)
        bench.set_fixture(locked=True, position_rad=0.0, mass_kg=1.0, direction=1)
        found.append(bench._fixture.mount.gain_nm_per_v / 6.6 - 1.0)
    # chi-square with 200 degrees of freedom, false alarm 1e-6 on either side
    total = float(np.sum(np.square(found))) / spread**2
    assert chi2.ppf(1e-6, 200) < total < chi2.ppf(1 - 1e-6, 200)
