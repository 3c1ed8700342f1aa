"""An angle integrated from a noisy velocity drifts; the diagnosis reads the drift from ripple."""

import numpy as np
import pytest

from hdbench.diagnosis import diagnose_trace
from hdbench.diagnosis.measured.drift import turned_motion, without_drift
from hdbench.model import motion_from_trace
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
NOISE_NM = 0.01
# the profile's tacho: 0.001 V
VELOCITY_NOISE = 0.06


def bare_trace(extra=lambda time, angle: 0.0, n=12_000, seed=0, velocity_noise=VELOCITY_NOISE):
    """Return time, speed and torque alone, and the true angle, of a sine of speed."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) * 1e-3
    speed = 90.0 + 40.0 * np.sin(2.0 * np.pi * time / 9.0)
    angle = 90.0 * time + 40.0 * 9.0 / (2.0 * np.pi) * (1.0 - np.cos(2.0 * np.pi * time / 9.0))
    drive = 40.0 * 2.0 * np.pi / 9.0 * np.cos(2.0 * np.pi * time / 9.0)
    torque = 0.5 * np.cos(2 * angle + 0.6) + 0.3 * np.cos(4 * angle - 1.1) + 1.725e-4 * drive
    torque += 0.7 * np.cos(angle / 100 + 0.3) + extra(time, angle)
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed + velocity_noise * rng.standard_normal(n),
        "torque_nm": torque + NOISE_NM * rng.standard_normal(n),
    }
    return Trace(columns), angle


def away(motion, angle):
    """Scatter of an angle about the true one: a constant is the phases' business."""
    return np.std(motion.angle_rad - angle)


def test_drift_is_taken_out_to_what_the_ripple_can_tell():
    trace, angle = bare_trace(seed=2)
    left = motion_from_trace(trace, PROFILE.data)
    # the contract's rule lies half a sample behind, which is not the drift's business
    speed = trace["motor_velocity_rad_s"]
    motion = turned_motion(left, left.angle_rad + 0.5e-3 * (speed - speed[0]))
    turned = without_drift(motion, PROFILE.data, trace["torque_nm"], motion.valid)
    # random walk of sigma^2 h t: its scatter over T is sigma sqrt(h T / 6) on average
    walk = VELOCITY_NOISE * np.sqrt(1e-3 * 12.0 / 6.0)
    assert away(motion, angle) > 0.3 * walk
    # a steady-state smoother of a walk q per s seen through slope^2 / (2 sigma^2 h) of information
    # per s has the variance sqrt(q / information) / 2; twice the deviation for the phase constants
    information = ((2 * 0.5) ** 2 + (4 * 0.3) ** 2) / (2.0 * NOISE_NM**2 * 1e-3)
    bound = np.sqrt(0.5 * np.sqrt(VELOCITY_NOISE**2 * 1e-3 / information))
    assert away(turned, angle) < 2.0 * bound


def test_velocity_without_noise_is_left_alone():
    trace, _ = bare_trace()
    still = dict(trace.columns)
    still["motor_velocity_rad_s"] = np.full(len(trace), 80.0)
    motion = motion_from_trace(Trace(still), PROFILE.data)
    assert without_drift(motion, PROFILE.data, trace["torque_nm"], motion.valid) is motion


def test_an_order_beside_the_ripple_is_no_drift():
    trace, _ = bare_trace(lambda t, a: 0.2 * np.cos(2.02 * a))
    (cause,) = diagnose_trace(trace, PROFILE, materiality=0.0).causes
    assert cause.name == "ripple-harmonic"
    # a tenth of the resolution of 172 turns
    assert cause.parameters["order"]["value"] == pytest.approx(2.02, abs=6e-4)


def test_a_clean_record_without_encoder_has_no_finding_of_any_size():
    for seed in (0, 1, 2):
        result = diagnose_trace(bare_trace(n=20_000, seed=seed)[0], PROFILE, materiality=0.0)
        assert result.verdict == "nothing-found"


def test_a_tone_at_the_ripple_frequency_leaves_no_second_name():
    # at 90 rad/s order 2 has 28.6 Hz
    trace, _ = bare_trace(lambda t, a: 0.07 * np.cos(2.0 * np.pi * 28.6 * t), seed=3)
    (cause,) = diagnose_trace(trace, PROFILE, materiality=0.0).causes
    assert cause.parameters["frequency_hz"]["value"] == pytest.approx(28.6, abs=0.01)
