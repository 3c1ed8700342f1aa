from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from changing import with_keys

from hdbench.model import Motion
from hdbench.profile import ProfileData


@pytest.fixture(scope="session")
def turning(bench: ProfileData) -> ProfileData:
    """The same bench with a flexspline that turns."""
    return with_keys(bench, drive={"flexspline": "turning"})


@pytest.fixture(scope="session")
def make_motion() -> Callable[..., Motion]:
    """A motion whose channels have nothing to do with each other, so that none hides another."""

    def make(n: int = 400, seed: int = 1, **replaced: Any) -> Motion:
        rng = np.random.default_rng(seed)
        values: dict[str, Any] = {
            "time_s": 3.0 + np.cumsum(rng.uniform(0.5e-3, 1.5e-3, n)),
            "velocity_rad_s": rng.uniform(-80.0, 80.0, n),
            "angle_rad": rng.uniform(-2e3, 2e3, n),
            "acceleration_rad_s2": rng.uniform(-2e3, 2e3, n),
            "output_angle_rad": rng.uniform(-20.0, 20.0, n),
            "valid": np.ones(n, dtype=bool),
            "angle_source": "encoder_count",
            "gear_ratio": 100.0,
            "load_torque_nm": rng.uniform(-30.0, 30.0, n),
            "motor_current_a": rng.uniform(-5.0, 5.0, n),
            "temperature_c": rng.uniform(20.0, 40.0, n),
            "inertia_nm_s2": 1.725e-4,
            "ripple_slope_nm_per_rad": rng.uniform(-4.0, 4.0, n),
        }
        return Motion(**{**values, **replaced})

    return make


@pytest.fixture
def swinging(make_motion: Callable[..., Motion]) -> Motion:
    """A motor that swings to and fro under a load that changes slower, sampled unevenly."""
    time = 5.0 + np.cumsum(np.random.default_rng(3).uniform(0.5e-3, 2e-3, 3000))
    return make_motion(
        3000,
        time_s=time,
        angle_rad=2.0 * np.sin(9.0 * time),
        velocity_rad_s=18.0 * np.cos(9.0 * time),
        acceleration_rad_s2=-162.0 * np.sin(9.0 * time),
        load_torque_nm=8.0 * np.sin(2.1 * time) + 3.0 * np.sin(11.0 * time),
    )
