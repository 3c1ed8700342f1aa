"""A reading counts only when it stands still; one that swings is averaged over whole periods."""

import math

import numpy as np
import pytest

from hdbench.session.calibrating.settling import (
    SettleRule,
    average_now,
    find_swing,
    judge,
    whole_period_mean,
)

BAND_V = 0.003
NOISE_V = 0.0076
PERIOD_S = 0.01
RULE = SettleRule(PERIOD_S, 100, BAND_V, 0, 3000)


def first_reading(samples, rule=RULE, block=20):
    """Judge as samples come, and return the reading with the number of samples it took."""
    for n in range(block, len(samples) + 1, block):
        judged = judge(samples[:n], rule)
        if judged.reading is not None:
            return judged.reading, n
    return None, len(samples)


def pendulum_v(seconds: float, *, angle_rad: float, length_m: float, level_v: float = 1.5):
    """Return the vertical force of a pendulum by its equation of motion, as volts.

    Integrated with steps of 1 ms (leapfrog: energy errors of 1e-6), so that nothing of the product
    is its own judge: T = m g cos(a) + m l a'^2, vertical part T cos(a), over m g.
    """
    gravity, step = 9.8065, 1e-3
    angle, speed, forces = angle_rad, 0.0, []
    for _ in range(round(seconds / step)):
        speed -= 0.5 * step * gravity / length_m * math.sin(angle)
        angle += step * speed
        speed -= 0.5 * step * gravity / length_m * math.sin(angle)
        tension = gravity * math.cos(angle) + length_m * speed**2
        forces.append(tension * math.cos(angle) / gravity)
    return level_v * np.array(forces)[:: round(PERIOD_S / step)]


def test_white_noise_around_a_constant_settles_in_two_windows():
    rng = np.random.default_rng(1)
    # 3 sigma on the mean and a factor 1.5 on the spread: a false refusal is below 1 % per window
    accepted = sum(
        judge(2.0 + NOISE_V * rng.standard_normal(200), RULE).reading is not None
        for _ in range(200)
    )
    assert accepted >= 190


def test_creep_faster_than_the_band_does_not_settle():
    rng = np.random.default_rng(3)
    samples = 2.0 + 0.02 * np.arange(200) * PERIOD_S + 0.0005 * rng.standard_normal(200)
    assert judge(samples, RULE).reading is None


def test_too_few_samples_are_no_reading_and_the_bar_says_how_far_it_is():
    assert judge(np.ones(199), RULE).reading is None
    shares = [judge(np.ones(n), RULE).share for n in (30, 80, 140, 200)]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert 0.0 < shares[1] < 1.0


def test_nothing_is_averaged_before_the_earliest_moment():
    rule = SettleRule(PERIOD_S, 100, BAND_V, 500, 3000)
    reading, n = first_reading(np.full(3000, 1.0), rule)
    assert reading is not None
    assert n == 600


@pytest.mark.parametrize("length_m", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("angle_rad", [0.1, 0.2, 0.35])
def test_a_swinging_weight_reads_as_the_weight_itself(length_m, angle_rad):
    rng = np.random.default_rng(5)
    samples = pendulum_v(30.0, angle_rad=angle_rad, length_m=length_m)
    reading, n = first_reading(samples + NOISE_V * rng.standard_normal(len(samples)))
    assert reading is not None
    assert n < len(samples)
    # a weight whose swing is within the band's size may be read as it is; a swing of the force by
    # angle squared (1 % to 12 %) must be gone: noise of the mean below 0.8 mV, band 3 mV
    assert reading.mean_v == pytest.approx(1.5, abs=BAND_V)
    if reading.swing is not None:
        # the force goes through two periods per swing; amplitude lengthens the period by a^2/16
        small = math.pi * math.sqrt(length_m / 9.8065)
        assert reading.swing.period_s == pytest.approx(small * (1 + angle_rad**2 / 16), rel=5e-3)


@pytest.mark.parametrize("angle_rad", [0.1, 0.15, 0.2, 0.25])
def test_a_swing_that_hides_in_the_noise_does_not_move_the_reading(angle_rad):
    errors = []
    samples = pendulum_v(30.0, angle_rad=angle_rad, length_m=0.3, level_v=0.37)
    for seed in range(6):
        rng = np.random.default_rng([17, seed])
        noisy = samples + NOISE_V * rng.standard_normal(len(samples))
        reading, _ = first_reading(noisy[int(rng.integers(0, 60)) :])
        assert reading is not None
        errors.append(reading.mean_v - 0.37)
    # noise of a mean of 100 samples is 0.76 mV, a hidden swing may add a third of the band; four
    # standard deviations of the mean of six
    assert abs(float(np.mean(errors))) < 4 * 0.76e-3 / math.sqrt(6)
    assert max(map(abs, errors)) < BAND_V / 3 + 4 * 0.76e-3


def test_white_noise_is_no_swing():
    rng = np.random.default_rng(7)
    # chance 1e-4 per look: 300 looks show more than 2 with probability 4e-6
    looks = [find_swing(NOISE_V * rng.standard_normal(400), PERIOD_S) for _ in range(300)]
    assert sum(look is not None for look in looks) <= 2


def test_the_mean_over_whole_periods_of_a_sine_is_its_centre_at_any_phase_and_length():
    rng = np.random.default_rng(9)
    for _ in range(50):
        n_period, phase = rng.uniform(20.0, 120.0), rng.uniform(0.0, 2 * math.pi)
        samples = 1.0 + np.cos(2 * math.pi * np.arange(1000) / n_period + phase)
        # straight lines between samples of a cosine are off by (pi/n)^2/3 of it at both ends only
        allowed = 2.0 * (math.pi / n_period) ** 2 / 3.0
        assert whole_period_mean(samples, 6 * n_period) == pytest.approx(1.0, abs=allowed)


def test_a_mean_over_a_part_of_a_sample_is_the_area_under_the_straight_lines():
    samples = np.array([0.0, 1.0, 3.0, 4.0])
    # from 0.5 before the second-last knot: lines 1..3 and 3..4, area by hand
    assert whole_period_mean(samples, 1.0) == pytest.approx(3.5)
    assert whole_period_mean(samples, 1.5) == pytest.approx((3.5 + 0.5 * 2.5) / 1.5)
    assert whole_period_mean(samples, 2.0) == pytest.approx((3.5 + 2.0) / 2.0)


def test_what_does_not_settle_is_averaged_as_it_is_and_marked():
    rng = np.random.default_rng(11)
    samples = np.cumsum(0.01 * rng.standard_normal(3000))
    reading = average_now(samples, RULE)
    assert not reading.settled
    assert math.isfinite(reading.mean_v)


def test_the_reading_tells_slope_and_correlation_of_its_samples():
    rng = np.random.default_rng(13)
    slow = np.convolve(rng.standard_normal(4000), [1.0, 0.9], mode="valid")[:400]
    reading = average_now(1.0 + 1e-3 * slow, SettleRule(PERIOD_S, 400, 1.0, 0, 3000))
    # MA(1) with 0.9: lag-1 correlation 0.9 / 1.81 = 0.497; its estimate scatters by 1/sqrt(400)
    assert reading.lag1 == pytest.approx(0.497, abs=0.15)
    ramp = judge(0.5 * PERIOD_S * np.arange(100.0), RULE)
    assert ramp.slope_v_s == pytest.approx(0.5, rel=1e-9)
