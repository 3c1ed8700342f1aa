from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
import pytest

from hdbench.model import Motion, catalogue

# 172 s at 1 kHz
N = 172_000


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


def lines_executed(work: Callable[[], object], enough: int) -> int:
    """Count lines of Python that run, up to enough."""
    count = 0

    def trace(_frame: object, event: str, _argument: object) -> object:
        nonlocal count
        if count >= enough:
            return None
        count += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)  # type: ignore[arg-type]
    try:
        work()
    finally:
        sys.settrace(before)
    return count


@pytest.mark.parametrize("name", [name for name, c in catalogue().items() if c.additive])
def test_columns_take_no_step_of_python_for_a_sample(name: str, long_motion: Motion) -> None:
    cause = catalogue()[name]
    shape = {}
    for parameter in cause.shape:
        low, high = (parameter.bands or ((parameter.lower, parameter.upper),))[0]
        shape[parameter.name] = (low * high) ** 0.5 if low > 0.0 else 0.5 * (low + high)
    cause.columns(long_motion, shape)  # what is made once is made
    # whole columns at a time take tens of lines; what is carried on from turn to turn of the load
    # or in blocks takes some ten thousand; a step for each sample takes N at the least
    assert lines_executed(lambda: cause.columns(long_motion, shape), N) < N // 4
