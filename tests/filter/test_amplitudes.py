"""A running filter tells the amplitude of each order, whatever phase its states are kept in."""

from __future__ import annotations

import numpy as np
import pytest

from hdbench.filter import FilterModel, OnlineFilter, OscillatorBlock, SlowBlock
from hdbench.filter.online import block_amplitudes

RATE_HZ = 1000.0
MODEL = FilterModel(
    name="tuned",
    blocks=(
        OscillatorBlock(2.0, "ripple", 1e-7, "motor-radian"),
        OscillatorBlock(4.0, "ripple", 1e-7, "motor-radian"),
    ),
    measurement_noise=0.05**2,
    load_inertia_kg_m2=0.0,
    gear_ratio=100.0,
    differentiator_time_constant_s=0.02,
    use_measured_angle=True,
    provenance={},
    slow=(SlowBlock("random-walk", noise_per_s=1e-3),),
    order_prior_std_nm=2.0,
    slow_prior_std_nm=1.0,
)


def filtered(seed: int) -> tuple[OnlineFilter, float, float]:
    rng = np.random.default_rng(seed)
    time = np.arange(8000) / RATE_HZ
    velocity = 100.0 + 30.0 * np.sin(0.7 * time)
    angle = np.cumsum(velocity) / RATE_HZ
    second, fourth = rng.uniform(0.5, 1.5), rng.uniform(0.2, 0.6)
    torque = (
        second * np.cos(2 * angle + 1.0)
        + fourth * np.cos(4 * angle - 2.0)
        + 0.05 * rng.standard_normal(len(time))
    )
    online = OnlineFilter(MODEL)
    online.process(time, velocity, torque, angle)
    return online, second, fourth


@pytest.mark.parametrize("seed", range(4))
def test_amplitudes_are_those_of_the_signal_within_their_own_uncertainty(seed: int) -> None:
    online, second, fourth = filtered(seed)
    found = block_amplitudes(MODEL, online.state())
    assert [a.block.order for a in found] == [2.0, 4.0]
    for amplitude, truth in zip(found, (second, fourth), strict=True):
        # 5 sigma: a chance of 6e-7 each that a right filter fails here
        assert abs(amplitude.amplitude_nm - truth) < 5.0 * amplitude.std_nm
        # 8000 samples of 0.05 N m fix an amplitude to 0.05 sqrt(2 / 8000) if nothing changed;
        # the walk of the states leaves less than a fifth of the noise
        assert 0.05 * np.sqrt(2 / 8000) < amplitude.std_nm < 0.01


def test_a_filter_that_has_seen_nothing_has_no_amplitude() -> None:
    for amplitude in block_amplitudes(MODEL, OnlineFilter(MODEL).state()):
        assert amplitude.amplitude_nm == 0.0
