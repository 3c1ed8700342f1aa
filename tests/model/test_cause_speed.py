from __future__ import annotations

from collections.abc import Callable
from time import process_time

import numpy as np
import pytest

from hdbench.model import Motion, catalogue

# 172 s at 1 kHz
N = 172_000
# columns that solve an equation of motion, or carry eight elements along
SLOW = {"torsional-resonance", "cubic-stiffness", "piecewise-stiffness", "hysteresis"}


@pytest.fixture(scope="module")
def long_motion() -> Motion:
    rng = np.random.default_rng(5)
    time = np.arange(N) * 1e-3
    return Motion(
        time_s=time,
        velocity_rad_s=200.0 * np.sin(0.1 * time),
        angle_rad=2000.0 * (1.0 - np.cos(0.1 * time)),
        acceleration_rad_s2=20.0 * np.cos(0.1 * time) + rng.normal(0.0, 3.0, N),
        output_angle_rad=20.0 * (1.0 - np.cos(0.1 * time)),
        valid=np.ones(N, dtype=bool),
        angle_source="encoder_count",
        gear_ratio=100.0,
        load_torque_nm=20.0 * np.sin(0.7 * time) + rng.normal(0.0, 0.05, N),
        motor_current_a=rng.normal(0.0, 1.0, N),
        inertia_nm_s2=1.725e-4,
    )


def fastest(work: Callable[[], object]) -> float:
    times = []
    for _ in range(3):
        begin = process_time()
        work()
        times.append(process_time() - begin)
    return min(times)


@pytest.mark.parametrize("name", [name for name, c in catalogue().items() if c.additive])
def test_columns_cost_no_more_than_some_sines(name: str, long_motion: Motion) -> None:
    cause = catalogue()[name]
    shape = {}
    for parameter in cause.shape:
        low, high = (parameter.bands or ((parameter.lower, parameter.upper),))[0]
        shape[parameter.name] = (low * high) ** 0.5 if low > 0.0 else 0.5 * (low + high)
    unit = fastest(lambda: catalogue()["ripple-harmonic"].columns(long_motion, {"order": 2.0}))
    cost = fastest(lambda: cause.columns(long_motion, shape))
    # a cosine and a sine of 172 000 samples take 4 ms of the processor; a Python step for each
    # sample takes as much for each of its operations. Thrice what was measured: caches are shared
    assert cost < (50.0 if name in SLOW else 10.0) * (1.0 + 0.5 * len(cause.linear)) * unit
