"""Answers on lines: beside a drifting angle, at orders that are not whole, through a resonance."""

import numpy as np
import pytest
from swinging_shaft import NOISE_NM, reversing, swing, trace_of

from hdbench.diagnosis import diagnose_trace
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")


def bare_trace(extra, n=12_000, seed=0, velocity_noise=0.06):
    """Return time, speed and torque alone."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) * 1e-3
    ripple = ((2.0, 0.5, 0.6), (4.0, 0.3, -1.1), (0.01, 0.7, 0.3))
    speed, angle, torque = swing(time, ripple=ripple)
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed + velocity_noise * rng.standard_normal(n),
        "torque_nm": torque + extra(time, angle) + 0.01 * rng.standard_normal(n),
    }
    return Trace(columns)


def test_a_tone_at_the_ripple_frequency_leaves_no_second_name():
    # at 90 rad/s order 2 has 28.6 Hz
    trace = bare_trace(lambda t, a: 0.07 * np.cos(2.0 * np.pi * 28.6 * t), seed=3)
    (cause,) = diagnose_trace(trace, PROFILE, materiality=0.0).causes
    assert cause.parameters["frequency_hz"].value == pytest.approx(28.6, abs=0.01)


def line_at(order):
    def extra(angle, _speed, _load):
        return 0.02 * np.cos(order * angle + 0.7)

    return diagnose_trace(reversing(extra, seed=3), PROFILE, materiality=0.0)


def test_a_line_on_a_few_turns_is_no_bearings():
    # 12 turns to and fro: what repeats along the way has any order
    result = line_at(3.37)
    (cause,) = result.causes
    assert cause.name == "ripple-harmonic"
    assert not cause.rivals
    assert cause.parameters["order"].value == pytest.approx(3.37, abs=0.005)
    (reason,) = [t.because for t in result.testable if t.name == "bearing-defect"]
    assert "12.2 turns; needed: 100" in reason


def test_a_single_line_at_a_whole_order_is_a_ripple():
    (cause,) = line_at(6.0).causes
    # six poles or slots without a second harmonic are the same line
    assert cause.name == "ripple-harmonic"
    assert set(cause.rivals) <= {"cogging"}


@pytest.mark.parametrize(
    "hertz",
    [
        pytest.param(75.0, marks=pytest.mark.campaign),
        85.0,
        pytest.param(93.0, marks=pytest.mark.campaign),
    ],
)
def test_a_narrow_resonance_is_seen_wherever_it_lies(hertz):
    time = np.arange(24_000) * 1e-3
    speed, angle, torque = swing(
        time, 150.0, 140.0, 12.0, ((2.0, 0.4, 0.0), (4.0, 0.2, -0.5 * np.pi))
    )
    ratio = 2.0 * speed / (2.0 * np.pi * hertz)
    passed = np.exp(2j * angle) / (1.0 - ratio**2 + 2j * 0.03 * ratio)
    torque += 0.0022 * passed.real + NOISE_NM * np.random.default_rng(3).standard_normal(len(time))
    found = diagnose_trace(trace_of(time, speed, angle, torque), PROFILE, materiality=0.0)
    assert found.causes[0].name == "torsional-resonance"
