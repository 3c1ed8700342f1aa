"""Motor and servo amplifier against closed forms and a general integrator."""

import math

import numpy as np
import pytest
from changing import REPORT
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from hdbench.plant.servo import ServoLoop, motor_current_a

LOOP = ServoLoop(2.0 * math.pi * 15.0, 2500.0)


def _integrated(commands: list[float], hold_s: float, n_samples: int) -> np.ndarray:
    """Integrate the equation of the loop by a Runge-Kutta method, hold by hold."""
    state, out = np.zeros(2), []
    exact = {"rtol": 1e-10, "atol": 1e-10, "max_step": hold_s / 50}
    times = np.linspace(0.0, hold_s, n_samples + 1)
    for command in commands:

        def slope(_: float, y: np.ndarray, command: float = command) -> list[float]:
            return [y[1], max(-2500.0, min(2500.0, LOOP.rate_per_s * (command - y[1])))]

        found = solve_ivp(slope, (0.0, hold_s), state, t_eval=times, **exact).y
        out.append(found[:, :-1])
        state = found[:, -1]
    return np.concatenate(out, axis=1)


@settings(max_examples=15)
@given(st.lists(st.floats(-400.0, 400.0), min_size=2, max_size=5))
def test_motion_agrees_with_a_general_integrator(commands):
    motion = LOOP.run(np.array(commands), 0.004, 5, (0.0, 0.0, 0.0))
    angle, speed = _integrated(commands, 0.02, 5)
    # the integrator steps over the corner of the limit: 2500 rad/s^2 over 0.4 ms steps, controlled
    np.testing.assert_allclose(motion.velocity_rad_s.ravel(), speed, rtol=0, atol=1e-4)
    np.testing.assert_allclose(motion.angle_rad.ravel(), angle, rtol=0, atol=1e-5)


def test_mean_acceleration_is_the_gain_in_speed():
    commands = 100.0 * np.sin(np.arange(200) * 0.02)
    motion = LOOP.run(commands, 1e-4, 10, (0.0, 0.0, 0.0))
    acceleration = motion.acceleration_rad_s2.ravel()
    gained = np.sum(acceleration[1:]) * 1e-4 + 0.5e-4 * acceleration[0]
    # trapezoid over an exponential of 10.6 ms in steps of 0.1 ms: (k h)^2 / 12 = 7e-6, and half a
    # step at the open end
    end = motion.start_velocity_rad_s[-1] - 0.5e-4 * acceleration[-1]
    assert gained == pytest.approx(end, rel=2e-5)


def test_current_reaches_its_limit_at_the_acceleration_limit():
    servo = REPORT.servo
    still = np.zeros(3)
    current = motor_current_a(servo, np.array([2500.0, -1250.0, 9999.0]), still)
    # products of three numbers: rounding
    np.testing.assert_allclose(current, [10.0, -5.0, 10.0], rtol=1e-12, atol=0)
    # 0.02 N m of friction at 0.05 N m/A
    assert motor_current_a(servo, still, still + 0.02)[0] == pytest.approx(0.4, rel=1e-12)
