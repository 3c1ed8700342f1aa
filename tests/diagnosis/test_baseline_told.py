"""Baseline of a diagnosis: given with its uncertainty, as are causes that look like the zero."""

from __future__ import annotations

import numpy as np
import pytest
from swinging_shaft import NOISE_NM, swing, trace_of

from hdbench.diagnosis import diagnose_trace
from hdbench.profile import load_profile
from hdbench.records import Trace

PROFILE = load_profile("cim-tr-97-06")
# not the profile's 0.4 and 0.2 N m
ORDERS_NM = {2.0: 0.46, 4.0: 0.17}


def swinging(mean: float, size: float) -> Trace:
    """Return 10 s of free motion, 5 s a swing."""
    time = np.arange(10_000) * 1e-3
    lines = tuple((order, amplitude, order) for order, amplitude in ORDERS_NM.items())
    speed, angle, torque = swing(time, mean, size, 5.0, lines)
    noise = NOISE_NM * np.random.default_rng(0).standard_normal(time.size)
    return trace_of(time, speed, angle, torque + noise)


@pytest.fixture(scope="module")
def told() -> dict[str, dict[str, object]]:
    motions = {"one way": (80.0, 40.0), "both ways": (0.0, 120.0)}
    return {
        name: dict(diagnose_trace(swinging(*motion), PROFILE).settings)
        for name, motion in motions.items()
    }


@pytest.mark.parametrize("motion", ["one way", "both ways"])
def test_ripple_of_the_baseline_has_its_size_and_the_bound_of_its_noise(told, motion):
    found = {item["order"]: item for item in told[motion]["baseline_ripple"]}
    assert set(found) == set(ORDERS_NM)
    bound = NOISE_NM * np.sqrt(2.0 / 10_000)  # Cramer-Rao, amplitude of a sinusoid in white noise
    for order, size in ORDERS_NM.items():
        assert found[order]["std_nm"] == pytest.approx(bound, rel=0.1)
        # four standard deviations: 6e-5 that right code misses
        assert abs(found[order]["amplitude_nm"] - size) < 4.0 * found[order]["std_nm"]


def test_friction_of_one_direction_is_not_told_from_the_zero(told):
    alike = {item["cause"]: item["own_share"] for item in told["one way"]["not_told_from_zero"]}
    assert alike["coulomb-friction"] == pytest.approx(0.0, abs=1e-9)
    # what a constant leaves of the speed itself: var / mean square = (40^2 / 2) / (80^2 + 40^2 / 2)
    assert alike["viscous-friction"] == pytest.approx(800.0 / 7200.0, rel=1e-3)


def test_friction_in_both_directions_is_told(told):
    assert told["both ways"]["not_told_from_zero"] == []
