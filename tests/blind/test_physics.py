"""The bench and its effects are what they are said to be."""

import numpy as np
import pytest
from injector.bench import KINDS, Noise
from injector.build import Case, Hidden, build, family_of
from injector.family import branch_loop, effect
from injector.geometry import Whitened
from injector.loads import build_loads
from rivals.oracle import measured_rest, oracle


def rest_of(made):
    scene = made.scene
    torque = measured_rest(made)
    columns = scene.baseline()
    return torque - columns @ np.linalg.lstsq(columns, torque, rcond=None)[0]


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_noise_has_its_size_and_whitens_to_unit_white_noise(kind):
    noise = Noise(kind, 0.05)
    drawn = np.concatenate([noise.draw(50_000, np.random.default_rng(k)) for k in range(4)])
    # 1/f noise has 40 independent swings of its slowest part here: 20 %
    assert drawn.std() == pytest.approx(0.05, rel=0.2 if kind == "flicker" else 0.02)
    white = noise.whiten(noise.draw(50_000, np.random.default_rng(9)))[100:]
    # 50 000 samples: five standard deviations
    assert white.var() == pytest.approx(1.0, abs=5.0 * (2.0 / 50_000) ** 0.5)
    for lag in (1, 2, 7, 50):
        assert abs(np.mean(white[lag:] * white[:-lag])) < 5.0 / 50_000**0.5


@pytest.mark.parametrize("record", ["constant", "mixed", "compact"])
def test_clean_record_leaves_white_noise_of_the_stated_size(record):
    left = rest_of(build(Case("clean", "A", record, seed=6)))
    count = len(left)
    # 0.0001 N m^2 are the converter's and the encoder's; five standard deviations
    assert left.std() == pytest.approx(0.05, rel=5.0 / (2.0 * count) ** 0.5 + 0.002)
    for lag in (1, 2, 20):
        assert abs(left[lag:] @ left[:-lag]) / (left @ left) < 5.0 / count**0.5
    means = [part.mean() * len(part) ** 0.5 / 0.05 for part in np.array_split(left, 20)]
    # chi^2 with some 14 to 20 degrees of freedom: below 60 but for one record in 10^5
    assert np.sum(np.square(means)) < 60.0


@pytest.mark.parametrize("name", ["coulomb-friction", "hysteresis", "saturation", "time-skew"])
@pytest.mark.parametrize("noise", [pytest.param("white", marks=pytest.mark.campaign), "ar"])
def test_size_in_sigmas_is_what_a_matched_filter_measures(name, noise):
    made = build(Case("d", "B", "compact", noise, seed=8, hidden=(Hidden(name, "d20"),)))
    truth, scene = made.truth["hidden"][0], made.scene
    white, family = Whitened(scene), family_of(name)
    slopes = white.tangents(scene, family, truth["shape"], truth["size"])
    template = white.rest(effect(family, scene, truth["shape"], truth["size"]), slopes)
    found = white.rest(measured_rest(made)) @ template / np.linalg.norm(template)
    assert truth["d"] == pytest.approx(20.0, rel=5e-3)
    # the filter's output has a standard deviation of 1
    assert found == pytest.approx(20.0, abs=4.5)


def test_bounds_are_those_of_a_line():
    made = build(Case("b", "B", "constant", seed=3, hidden=(Hidden("structural-tone", "d20"),)))
    truth = made.truth["hidden"][0]
    seconds = made.truth["seconds"]
    size = 0.05 * (2.0 / 40_000) ** 0.5
    assert truth["bounds"]["size"] == pytest.approx(size, rel=0.01)
    # var f = 6 sigma^2 / (pi^2 A^2 n T^2)
    hertz = (6.0 / 40_000) ** 0.5 * 0.05 / (np.pi * truth["size"] * seconds)
    assert truth["bounds"]["frequency_hz"] == pytest.approx(hertz, rel=0.01)


def test_group_of_an_order_at_one_speed_holds_the_tone():
    made = build(Case("g", "B", "constant", seed=4, hidden=(Hidden("ripple-harmonic", "d20"),)))
    alike = made.truth["hidden"][0]["alike"]
    other = build(Case("g", "B", "mixed", seed=4, hidden=(Hidden("ripple-harmonic", "d20"),)))
    assert alike["ripple-harmonic"] == 0.0
    assert "coulomb-friction" not in alike
    assert "structural-tone" not in other.truth["hidden"][0]["alike"]


def test_loop_is_bounded_independent_of_rate_and_has_memory():
    there = np.concatenate([np.linspace(0.0, 6.0, 50), np.linspace(6.0, -6.0, 100)])
    slow = np.interp(np.linspace(0, 149, 14901), np.arange(150), there)
    loop, fine = branch_loop(there, 1.5, 0.2), branch_loop(slow, 1.5, 0.2)
    assert np.abs(loop).max() < 1.0
    assert fine[::100] == pytest.approx(loop, abs=1e-9)
    # Dahl's law (skew 0) from rest: 1 - exp(-x / reach)
    line = np.linspace(0.0, 3.0, 31)
    assert branch_loop(line, 1.5, 0.0) == pytest.approx(1.0 - np.exp(-line / 1.5), abs=1e-12)
    assert loop[:50].mean() > 0.0 > loop[-1]


def test_a_channel_that_is_late_and_limited_acts_on_all_that_stands_in_it():
    names = ("time-skew", "ripple-harmonic", "saturation")
    made = build(Case("w", "C", "compact", seed=3, hidden=tuple(Hidden(n, "high") for n in names)))
    # 3 ms are three samples; the effects stand in the order of the case
    late, line, limit = made.torques
    assert [entry["size"] for entry in made.truth["hidden"]] == [0.003, 0.4, 1.0 / 26.0]
    limited = made.scene.clean + line + limit
    assert (limited + late)[3:] == pytest.approx(limited[:-3], abs=1e-9)
    # gentle or sharp, a limit has a gain of 1 at small torque and bends all of it
    power = made.truth["hidden"][2]["shape"]["power"]
    whole = made.scene.clean + line
    assert limited == pytest.approx(whole / (1.0 + np.abs(whole / 26.0) ** power) ** (1.0 / power))


def test_oracle_explains_what_was_hidden():
    made = build(Case("o", "B", "compact", seed=5, hidden=(Hidden("zero-step", "high"),)))
    best = oracle(made)
    assert best["after_nm"] == pytest.approx(0.05, rel=0.02)
    hidden = made.torques[0] - made.torques[0].mean()
    assert best["before_nm"] > (0.05**2 + 0.5 * hidden.var()) ** 0.5


def test_calibration_readings_are_gain_and_zeros_where_clean():
    made = build_loads(Case("l", "L", "loads", sigma_nm=0.005, seed=2))
    rows = made.columns["readings"]
    volts = np.array([row["reading_v"] for row in rows])
    columns = made.scene.baseline()
    left = volts - columns @ np.linalg.lstsq(columns, volts, rcond=None)[0]
    free = len(rows) - columns.shape[1]
    assert len(rows) == 144
    # the gain is drawn within 2 % of 6.6 N m/V; chi with 127 degrees of freedom, five sigma
    assert (left @ left / free) ** 0.5 == pytest.approx(0.005 / 6.6, rel=0.02 + 5.0 / 254**0.5)
