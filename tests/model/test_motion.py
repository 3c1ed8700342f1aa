import math
from typing import Any

import numpy as np
import pytest
from changing import with_keys
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from hdbench.errors import DataError
from hdbench.model import Motion, integrate_velocity, motion_from_trace
from hdbench.model.localfit import fit_derivative
from hdbench.profile import load_profile
from hdbench.records.trace import Trace

BENCH = load_profile("cim-tr-97-06").data
INERTIA = 1.725e-4  # J/N of the report's bench, N m s^2


def motion_of(time: np.ndarray, **columns: Any) -> Motion:
    return motion_from_trace(Trace({"time_s": time, **columns}), BENCH)


def test_velocity_is_integrated_sample_by_sample_as_the_contract_says():
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, 300))
    velocity = rng.normal(0.0, 50.0, 300)
    angle = [0.0]
    for k in range(299):
        angle.append(angle[k] + velocity[k] * (time[k + 1] - time[k]))
    assert motion_of(time, motor_velocity_rad_s=velocity).angle_rad.tolist() == angle


def test_the_best_angle_there_is_gets_used():
    time = np.arange(50) * 1e-3
    columns = {"tacho_v": np.ones(50)}
    by_tacho = motion_of(time, **columns)
    assert by_tacho.angle_source == "velocity"
    assert by_tacho.velocity_rad_s[0] == 56.2565
    count = np.arange(50.0) + 1000.0
    by_count = motion_of(time, encoder_count=count, **columns)
    assert by_count.angle_source == "encoder_count"
    # 1000 of 4000 counts are a quarter turn
    assert by_count.angle_rad[0] == pytest.approx(math.pi / 2, rel=1e-15, abs=0)
    by_angle = motion_of(time, motor_angle_rad=time + 7.0, encoder_count=count, **columns)
    assert by_angle.angle_source == "motor_angle_rad"
    assert by_angle.angle_rad[0] == 7.0
    assert by_angle.output_angle_rad[0] == 0.07
    both = motion_of(time, motor_angle_rad=time, output_angle_rad=time + 3.0, **columns)
    assert both.output_angle_rad[0] == 3.0
    assert both.output_source == "output_angle_rad"


@pytest.mark.parametrize(("source", "degree"), [("velocity", 3), ("angle", 4)])
def test_acceleration_agrees_with_savitzky_golay_of_scipy_up_to_the_ends(source, degree):
    time = np.arange(500) * 1e-3
    rng = np.random.default_rng(5)
    signal = rng.normal(0.0, 10.0, 500)
    columns = {"motor_velocity_rad_s": signal}
    if source == "angle":
        # less noise than in the velocity, so that it is the better source
        signal = np.sin(9.0 * time) + rng.normal(0.0, 1e-5, 500)
        columns["motor_angle_rad"] = signal
    found = motion_of(time, **columns)
    assert found.acceleration_source == source
    order = 1 if source == "velocity" else 2
    want = savgol_filter(signal, 21, degree, deriv=order, delta=1e-3, mode="interp")
    # values up to 1e4 with the rounding of a polynomial on 21 points
    np.testing.assert_allclose(found.acceleration_rad_s2, want, rtol=0, atol=1e-7)


def test_noise_of_the_expected_torque_is_small_and_stated():
    time = np.arange(60_000) * 1e-3
    rng = np.random.default_rng(6)
    volts = 1.0 + rng.normal(0.0, 0.001, len(time))
    found = motion_of(time, tacho_v=volts)
    torque = INERTIA * found.acceleration_rad_s2
    # least squares of slope and cubic term on k = -10..10: variance of the slope by Cramer's rule
    s2, s4, s6 = (sum(k**p for k in range(-10, 11)) for p in (2, 4, 6))
    want = INERTIA * 0.0562565 * math.sqrt(s6 / (s2 * s6 - s4**2)) / 1e-3
    # 60 000 samples of which each tenth is independent: 1 % of the standard deviation, 4 sigma
    assert float(torque[10:-10].std()) == pytest.approx(want, rel=0.04, abs=0)
    assert INERTIA * found.acceleration_noise_rad_s2 == pytest.approx(want, rel=0.04, abs=0)
    # far below the 0.05 N m of the torque channel, also at the two ends
    assert float(np.abs(torque).max()) < 0.01


def test_the_source_with_less_noise_gives_the_acceleration():
    time = np.arange(4000) * 1e-3
    rng = np.random.default_rng(7)
    velocity = 100.0 + 40.0 * np.sin(6.0 * time)
    angle = 100.0 * time - 40.0 / 6.0 * np.cos(6.0 * time)
    coarse = np.floor(angle / (2.0 * math.pi) * 4000.0)
    noisy = velocity + rng.normal(0.0, 0.06, len(time))
    found = motion_of(time, motor_velocity_rad_s=noisy, encoder_count=coarse)
    assert found.acceleration_source == "velocity"
    fine = motion_of(time, motor_velocity_rad_s=noisy, motor_angle_rad=angle)
    assert fine.acceleration_source == "angle"


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), coefficients=st.tuples(*[st.floats(-10.0, 10.0)] * 4))
def test_a_cubic_is_differentiated_exactly_on_any_grid(seed, coefficients):
    rng = np.random.default_rng(seed)
    time = 5.0 + np.cumsum(rng.uniform(0.6e-3, 1.7e-3, 120))
    values = np.polyval(coefficients, time - 5.0)
    lost = rng.random(120) < 0.1
    lost[:3] = False
    # single ones: two in a row may be a gap, and next to it a stretch too short for a slope
    lost[1:] &= ~lost[:-1]
    seen = np.where(lost, np.nan, values)
    fit = fit_derivative(time, seen, derivative=1, degree=3, window_s=0.02)
    want = np.polyval(np.polyder(coefficients), time - 5.0)
    assert (np.isnan(fit.derivative) == lost).all()
    # values below 10 with rounding 2e-15 over 10 ms, times the weight of an end point, some tens
    np.testing.assert_allclose(fit.derivative[~lost], want[~lost], rtol=0, atol=1e-8)


def test_a_lost_sample_is_not_valid_and_never_interpolated():
    time = np.arange(200) * 1e-3
    velocity = 20.0 + 30.0 * time
    velocity[[50, 51, 120]] = np.nan
    found = motion_of(time, motor_velocity_rad_s=velocity)
    lost = np.zeros(200, dtype=bool)
    lost[[50, 51, 120]] = True
    assert (found.valid == ~lost).all()
    assert np.isnan(found.velocity_rad_s[lost]).all()
    assert np.isnan(found.acceleration_rad_s2[lost]).all()
    # a straight line is its own fit: rounding of 20 rad/s over 10 ms
    np.testing.assert_allclose(found.acceleration_rad_s2[~lost], 30.0, rtol=0, atol=1e-9)
    # the step after each lost sample used the velocity held from before the gap
    assert found.bridged is not None
    assert np.flatnonzero(found.bridged).tolist() == [51, 52, 121]
    missing = (velocity[49] * 3 + velocity[52:119].sum()) * 1e-3
    assert found.angle_rad[119] - found.angle_rad[49] == pytest.approx(missing, rel=1e-12, abs=0)


def test_no_fit_reaches_over_a_gap_in_time():
    time = np.concatenate((np.arange(100), 100 + 400 + np.arange(100))) * 1e-3
    velocity = np.concatenate((10.0 + 50.0 * time[:100], 90.0 - 80.0 * time[100:]))
    found = motion_of(time, motor_velocity_rad_s=velocity)
    # straight lines of two slopes: exact up to the last sample before the gap and the first after
    np.testing.assert_allclose(found.acceleration_rad_s2[:100], 50.0, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.acceleration_rad_s2[100:], -80.0, rtol=0, atol=1e-8)
    assert found.bridged is not None
    assert np.flatnonzero(found.bridged).tolist() == [100]
    step = found.angle_rad[100] - found.angle_rad[99]
    assert step == pytest.approx(velocity[99] * 0.401, rel=1e-12, abs=0)


def test_a_lost_first_velocity_is_bridged_by_the_first_one_that_is_there():
    angle, bridged = integrate_velocity(np.arange(4.0), np.array([np.nan, 2.0, np.nan, 5.0]))
    assert angle.tolist() == [0.0, 2.0, 4.0, 6.0]
    assert bridged.tolist() == [False, True, False, True]


def test_an_isolated_sample_has_no_acceleration():
    time = np.concatenate((np.arange(50), [1000.0])) * 1e-3
    found = motion_of(time, motor_velocity_rad_s=np.ones(51))
    assert found.valid.tolist() == [True] * 50 + [False]


@pytest.mark.parametrize(
    ("time", "columns", "words"),
    [
        (np.arange(9.0), {"torque_nm": np.zeros(9)}, "no velocity"),
        (np.array([0.0, 1, 2, 2, 3, 4]), {"tacho_v": np.zeros(6)}, "time_s is .*2.0.* at sample 3"),
        (np.array([0.0, 1, np.nan, 3, 4, 5]), {"tacho_v": np.zeros(6)}, "at sample 2"),
        (np.arange(4.0), {"tacho_v": np.zeros(4)}, "4 of 4 samples"),
        (np.arange(9.0), {"tacho_v": np.full(9, np.nan)}, "0 of 9 samples"),
    ],
)
def test_a_record_without_motion_is_refused(time, columns, words):
    with pytest.raises(DataError, match=words):
        motion_of(time, **columns)


def test_further_channels_come_along():
    time = np.arange(9.0)
    extra = {"load_torque_nm": time, "motor_current_a": 2 * time, "temperature_c": 3 * time}
    found = motion_of(time, tacho_v=np.ones(9), **extra)
    assert all(getattr(found, name) is column for name, column in extra.items())


def test_the_motion_knows_whether_the_gauges_turn():
    trace = Trace({"time_s": np.arange(9.0), "tacho_v": np.ones(9)})
    turning = with_keys(BENCH, drive={"flexspline": "turning", "gear_ratio": 50.0})
    assert motion_from_trace(trace, BENCH).gauge_factor == 1.0
    # 1 + 1/50, exact to one rounding
    assert motion_from_trace(trace, turning).gauge_factor == pytest.approx(1.02, rel=1e-15, abs=0)
