"""Slow noise and the laws of looks against closed forms and plain sums."""

import numpy as np
import pytest
from scipy.special import gammaincc
from scipy.stats import chi2

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.detect.law import FamilyLaw
from hdbench.diagnosis.detect.steps import step_statistics
from hdbench.diagnosis.detect.survey import LineLaw
from hdbench.diagnosis.noise.slownoise import RANDOM_WALK, SlowNoise, SlowSpectrum, slow_kernel
from hdbench.diagnosis.noise.whitened import Whitener, make_space
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")


def walking_record(seed, step_nm):
    rng = np.random.default_rng(seed)
    time = np.arange(20_000) * 1e-3
    rate = 2.0 * np.pi / 9.0
    speed, angle = 90.0 + 40.0 * np.sin(rate * time), 90.0 * time
    angle = angle + 40.0 / rate * (1.0 - np.cos(rate * time))
    torque = 0.4 * np.cos(2 * angle) + 0.2 * np.cos(4 * angle) + 0.9 * np.cos(angle / 100)
    torque += 1.725e-4 * 40.0 * rate * np.cos(rate * time) + 0.05 * rng.standard_normal(len(time))
    torque += step_nm * np.cumsum(rng.standard_normal(len(time)))
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
        "torque_nm": torque,
    }
    return Trace(columns)


def test_kernel_has_the_inverse_root_of_the_spectrum():
    n, power = 4000, 300.0
    response = np.abs(np.fft.rfft(slow_kernel(SlowNoise(power, RANDOM_WALK, 0.0), n), 4 * n))
    half_cycles = np.arange(len(response)) / 2.0
    wanted = 1.0 / np.sqrt(1.0 + power / np.maximum(half_cycles, 0.5) ** 2)
    # cut off after n samples: what is left of the response there makes ripples of about a per cent
    np.testing.assert_allclose(response[4:], wanted[4:], rtol=0.02)


def test_power_of_a_random_walk_is_found():
    rng = np.random.default_rng(3)
    index = np.arange(1.0, 2001.0)
    squares = (1.0 + 400.0 / index**2) * rng.standard_normal(2000) ** 2
    found = SlowSpectrum(squares, np.ones(2000)).fit(RANDOM_WALK)
    # some twenty coefficients carry it: a third each way is two standard deviations
    assert 200.0 < found.power < 800.0
    white = SlowSpectrum(rng.standard_normal(2000) ** 2, np.ones(2000)).fit(RANDOM_WALK)
    assert white.gain_nats < 4.0 < found.gain_nats


def test_a_walking_zero_is_named_and_its_intensity_measured():
    result = diagnose_trace(walking_record(1, 1.2e-3), PROFILE)
    (cause,) = result.causes
    assert cause.name == "zero-random-walk"
    # 1.2 mN m at 1 kHz are 38 mN m in a second; known to a factor below two by its few cycles
    value = cause.parameters["intensity_nm_per_sqrt_s"]["value"]
    assert 0.5 < value / (1.2e-3 * np.sqrt(1e3)) < 2.0
    again = diagnose_trace(walking_record(1, 0.0), PROFILE)
    assert again.verdict == "nothing-found"


def test_the_gain_of_a_walk_is_that_of_straight_lines_over_what_is_left_out():
    step_nm, noise_nm = 1.2e-3, 0.05
    trace, still = walking_record(1, step_nm), walking_record(1, 0.0)
    walk = trace["torque_nm"] - still["torque_nm"]
    (cause,) = diagnose_trace(trace, PROFILE).causes
    # every fifth of twenty blocks in turn, from means of a tenth of a second on both sides of it
    blocks = np.split(np.arange(20_000), 20)
    left = np.empty(20_000)
    for fold in range(5):
        held = np.isin(np.arange(20_000) // 1000 % 5, fold)
        known = np.flatnonzero(~held)
        smooth = np.convolve(walk, np.ones(101) / 101.0, "same")
        for block in blocks[fold::5]:
            near = known[(known < block[0] - 50) | (known > block[-1] + 50)]
            left[block] = walk[block] - np.interp(block, near, smooth[near])
    after = np.sqrt(np.mean(left**2) + noise_nm**2)
    # the means hold noise, and the training keeps away from the blocks: some per cent
    assert cause.gain.heldout_rms_after_nm == pytest.approx(after, rel=0.05)
    before = np.sqrt(np.var(walk) + noise_nm**2)
    assert cause.gain.heldout_rms_before_nm > before
    low, high = cause.gain.interval
    assert 0.0 < low < cause.gain.explained_fraction < high < 1.0


def test_step_statistics_are_those_of_plain_regression():
    rng = np.random.default_rng(5)
    n = 300
    valid = np.ones(n, dtype=bool)
    base = np.ones((n, 1))
    response = rng.standard_normal(n) + 2.0 * (np.arange(n) >= 200)
    space = make_space(Whitener(np.ones(1), 1.0, valid, valid), base, response)
    found = step_statistics(space, space.pull[:, None])[:, 0]
    for at in (20, 150, 200, 280):
        design = np.column_stack([base, np.arange(n) >= at])
        without = np.sum((response - response.mean()) ** 2)
        rest = response - design @ np.linalg.lstsq(design, response, rcond=None)[0]
        assert found[at] == pytest.approx(without - rest @ rest, rel=1e-9)


def test_trials_of_a_scan_follow_one_law_near_and_far():
    law = LineLaw(50.0, 2, 1.0)
    near = law.probability(30.0) / float(chi2.sf(30.0, 2))
    assert law.trials(30.0) == pytest.approx(near, rel=1e-9)
    # the far form takes over at half a statistic of 100 and differs by the next term there
    assert law.trials(200.1) == pytest.approx(law.trials(199.9), rel=0.01)
    assert np.isfinite(law.trials(1e5))


def test_one_member_has_one_trial_and_many_pay_for_more_far_out():
    p = np.array([1e-3, 1e-9])
    assert list(FamilyLaw(0.0, 0, 1).trials(p)) == [1.0, 1.0]
    near, far = FamilyLaw(0.5, 1, 1).trials(p)
    assert 1.0 < near < far
    c = float(chi2.isf(1e-3, 1))
    assert float(gammaincc(0.5, c / 2.0)) == pytest.approx(1e-3)
    assert near == pytest.approx(1.0 + 0.5 * np.sqrt(c))


def with_gaps(trace, seconds=0.04, every=1.0):
    """Return a record with samples missing once a second."""
    torque = trace["torque_nm"].copy()
    phase = np.mod(trace.time_s, every)
    torque[(phase > 0.5) & (phase < 0.5 + seconds)] = np.nan
    return trace.with_columns(torque_nm=torque)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_walk_in_a_record_with_gaps_is_a_walk_and_nothing_else(seed):
    result = diagnose_trace(with_gaps(walking_record(seed, 2e-3)), PROFILE)
    (walk,) = [cause for cause in result.causes if cause.name != "missed-samples"]
    assert walk.name == "zero-random-walk"
    assert walk.false_alarm_probability < 0.01
    assert result.unexplained == ()


@pytest.mark.parametrize("seed", [4, 5])
def test_a_drift_beside_friction_is_no_walk(seed):
    trace = walking_record(seed, 0.0)
    time, speed = trace.time_s, trace["motor_velocity_rad_s"]
    rise = 0.06 * (1.0 - np.exp(-time / 6.0)) + 6e-4 * (speed - 90.0)
    result = diagnose_trace(trace.with_columns(torque_nm=trace["torque_nm"] + rise), PROFILE)
    found = {name for cause in result.causes for name in (cause.name, *cause.group, *cause.rivals)}
    assert "zero-random-walk" not in found
    assert {"warm-up", "viscous-friction"} <= found


def test_a_bump_at_one_output_angle_is_no_slow_noise():
    """What is slow of it, where it is passed slowly, a flicker takes as well."""
    rng = np.random.default_rng(2)
    time = np.arange(37_000) * 1e-3

    def after(start_s):
        return 0.5 * (1.0 + np.tanh((time - start_s) / 0.2))

    speed = 65.0 * after(1.0) * (1.0 - 2.0 * after(11.0)) * (1.0 - after(21.0))
    speed += 20.0 * np.sin(2.0 * np.pi * (time - 22.0) / 15.0) * after(22.0)
    angle = np.concatenate([[0.0], np.cumsum(0.5e-3 * (speed[1:] + speed[:-1]))])
    torque = 0.4 * np.cos(2 * angle) + 0.2 * np.cos(4 * angle)
    torque += 1.725e-4 * np.gradient(speed, time) + 0.05 * rng.standard_normal(len(time))
    torque += 0.022 * np.exp(-0.5 * ((angle / 100.0 - 0.6) / 0.03) ** 2)
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
        "torque_nm": torque,
    }
    found = diagnose_trace(Trace(columns), PROFILE, materiality=0.0)
    assert found.causes == ()
    (place,) = found.unexplained
    assert place.domain == "output-order"
    # within its own width
    assert place.location == pytest.approx(0.6, abs=0.03)
