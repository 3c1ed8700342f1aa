"""Answers where the zero walks or drifts: a walk is a walk, a drift beside friction is none."""

import numpy as np
import pytest

from hdbench.diagnosis import diagnose_trace
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


@pytest.mark.parametrize("seed", [4])
def test_a_drift_beside_friction_is_no_walk(seed):
    trace = walking_record(seed, 0.0)
    time, speed = trace.time_s, trace["motor_velocity_rad_s"]
    rise = 0.06 * (1.0 - np.exp(-time / 6.0)) + 6e-4 * (speed - 90.0)
    result = diagnose_trace(trace.with_columns(torque_nm=trace["torque_nm"] + rise), PROFILE)
    found = {name for cause in result.causes for name in (cause.name, *cause.group, *cause.rivals)}
    assert "zero-random-walk" not in found
    assert {"warm-up", "viscous-friction"} <= found
