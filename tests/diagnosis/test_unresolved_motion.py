"""Jumps of the acceleration: left out as far as their errors matter, and no further."""

import numpy as np
import pytest

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.measured.record import prepare_record
from hdbench.diagnosis.measured.resolved import unresolved_motion
from hdbench.model import BenchModel
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
INERTIA = 1.725e-4
N = 20_000
JUMPS = np.arange(1.0, 20.0)


def shaft(accel=400.0):
    """Time, angle, speed and acceleration of a triangle of the speed: it turns every second."""
    time = np.arange(N) * 1e-3
    part = time % 2.0
    up = part < 1.0
    rise = np.where(up, part, 2.0 - part)
    turned = np.where(up, 0.5 * part**2, 1.0 - 0.5 * (2.0 - part) ** 2)
    speed = accel * (rise - 0.5)
    angle = accel * (turned - 0.5 * part)
    return time, angle, speed, np.where(up, accel, -accel)


def record_of(noise_nm, extra=0.0, seed=1):
    time, angle, speed, accel = shaft()
    torque = INERTIA * accel + 0.4 * np.cos(2.0 * angle) + 0.2 * np.sin(4.0 * angle) + extra
    torque = torque + noise_nm * np.random.default_rng(seed).standard_normal(N)
    columns = {"time_s": time, "motor_angle_rad": angle, "motor_velocity_rad_s": speed}
    trace = Trace({**columns, "torque_nm": torque})
    model = BenchModel.from_profile(PROFILE.data)
    return prepare_record(trace, PROFILE.data, model, np.zeros(N, dtype=bool)), accel, trace


@pytest.mark.parametrize("noise_nm", [0.005, 0.05, 0.2])
def test_what_stays_weighs_less_than_half_a_standard_deviation(noise_nm):
    record, accel, _ = record_of(noise_nm)
    kept = record.valid & ~unresolved_motion(record, PROFILE.data)
    error = INERTIA * (record.motion.acceleration_rad_s2 - accel)[kept] / noise_nm
    assert np.sqrt(np.sum(error**2)) < 0.5


def test_no_more_is_left_out_than_the_windows_reach():
    record, _, _ = record_of(0.005)
    left_out = np.flatnonzero(unresolved_motion(record, PROFILE.data))
    away = np.min(np.abs(left_out[:, None] * 1e-3 - [0.0, *JUMPS, N * 1e-3]), axis=1)
    # half of the wide window, and a sample
    assert away.max() <= 0.0211
    assert all(np.any(np.abs(left_out * 1e-3 - jump) < 0.005) for jump in JUMPS)


def test_in_noise_far_above_the_errors_only_the_ends_are_left_out():
    record, _, _ = record_of(3.0)
    left_out = np.flatnonzero(unresolved_motion(record, PROFILE.data))
    assert len(left_out) <= 2 * 10
    assert np.all((left_out < 10) | (left_out >= N - 10))


def test_a_hidden_ripple_does_not_pass_for_noise():
    _, angle, _, _ = shaft()
    plain, _, _ = record_of(0.005)
    with_ripple, _, _ = record_of(0.005, 0.1 * np.cos(6.0 * angle))
    few = unresolved_motion(plain, PROFILE.data).sum()
    assert unresolved_motion(with_ripple, PROFILE.data).sum() > 0.6 * few


@pytest.mark.parametrize("hertz", [75.0, 85.0, 93.0])
def test_a_narrow_resonance_is_seen_wherever_it_lies(hertz):
    n = 24_000
    time = np.arange(n) * 1e-3
    speed = 150.0 + 140.0 * np.sin(2.0 * np.pi * time / 12.0)
    angle = 150.0 * time + 140.0 * 12.0 / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * time / 12.0))
    accel = 140.0 * 2.0 * np.pi / 12.0 * np.cos(2.0 * np.pi * time / 12.0)
    ratio = 2.0 * speed / (2.0 * np.pi * hertz)
    passed = np.exp(2j * angle) / (1.0 - ratio**2 + 2j * 0.03 * ratio)
    torque = INERTIA * accel + 0.4 * np.cos(2.0 * angle) + 0.2 * np.sin(4.0 * angle)
    torque += 0.0022 * passed.real + 0.05 * np.random.default_rng(3).standard_normal(n)
    columns = {"time_s": time, "motor_angle_rad": angle, "motor_velocity_rad_s": speed}
    found = diagnose_trace(Trace({**columns, "torque_nm": torque}), PROFILE, materiality=0.0)
    assert found.causes[0].name == "torsional-resonance"
