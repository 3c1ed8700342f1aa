"""Answers where the zero walks or drifts: a walk is a walk, a drift beside friction is none."""

import numpy as np
from swinging_shaft import NOISE_NM, RIPPLE, swing, trace_of

from hdbench.diagnosis import diagnose_trace
from hdbench.profile import load_profile

PROFILE = load_profile("cim-tr-97-06")


def test_a_drift_beside_friction_is_no_walk():
    time = np.arange(20_000) * 1e-3
    ripple = (*RIPPLE, (0.01, 0.9, 0.0))
    speed, angle, torque = swing(time, ripple=ripple)
    torque += NOISE_NM * np.random.default_rng(4).standard_normal(len(time))
    rise = 0.06 * (1.0 - np.exp(-time / 6.0)) + 6e-4 * (speed - 90.0)
    result = diagnose_trace(trace_of(time, speed, angle, torque + rise), PROFILE)
    found = {name for cause in result.causes for name in (cause.name, *cause.group, *cause.rivals)}
    assert "zero-random-walk" not in found
    assert {"warm-up", "viscous-friction"} <= found
