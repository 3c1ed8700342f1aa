"""Two causes that hide each other, and a step so strong that it bends its own noise."""

import numpy as np

from hdbench.diagnosis import diagnose_trace
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
NOISE_NM = 0.05


def loaded_trace(seed, extra):
    """Speed that reverses under a load of both signs."""
    n, rng = 16_000, np.random.default_rng(seed)
    time = np.arange(n) * 1e-3
    rate = 2.0 * np.pi / 4.0
    speed, angle = 60.0 * np.sin(rate * time), 60.0 / rate * (1.0 - np.cos(rate * time))
    load = 20.0 * np.sin(2.0 * np.pi * time / 9.7)
    torque = 0.4 * np.cos(2 * angle) + 0.2 * np.cos(4 * angle) + load
    torque += 1.725e-4 * 60.0 * rate * np.cos(rate * time) + extra(time, load)
    columns = {
        "time_s": time,
        "motor_velocity_rad_s": speed,
        "motor_angle_rad": angle,
        "load_torque_nm": load,
        "torque_nm": torque + NOISE_NM * rng.standard_normal(n),
    }
    return Trace(columns)


def test_a_gain_error_and_a_cube_that_nearly_cancel_are_both_named():
    def bent(_time, load):
        # of a sine the cube keeps three quarters at its own rate
        return 0.05 * (4.0 / 3.0 * (load / 20.0) ** 3 - load / 20.0)

    found = diagnose_trace(loaded_trace(3, bent), PROFILE, materiality=0.0)
    names = {name for cause in found.causes for name in (cause.name, *cause.group)}
    assert len(found.causes) == 2
    assert {"gain-error", "cubic-nonlinearity"} <= names
    assert found.unexplained == ()


def test_a_large_step_with_a_slope_is_a_step():
    def slope(time, _load):
        return 2.0 * np.clip((time - 7.0) / 0.03, 0.0, 1.0)

    found = diagnose_trace(loaded_trace(4, slope), PROFILE)
    assert [cause.name for cause in found.causes] == ["zero-step"]
    (cause,) = found.causes
    assert abs(cause.parameters["step_nm"]["value"] - 2.0) < 0.02
