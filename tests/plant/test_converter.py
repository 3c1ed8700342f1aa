"""Anti-alias filter, codes and counts against scipy and closed forms."""

import math

import numpy as np
import pytest
from scipy.signal import freqz

from hdbench.plant.converter import (
    HALF_LENGTH_SAMPLES,
    Decimator,
    steps_per_sample,
    to_code,
    to_count,
)


@pytest.mark.parametrize("n_steps", [4, 10, 100])
def test_filter_is_flat_in_the_pass_band_and_down_in_the_stop_band(n_steps):
    taps = Decimator.design(n_steps).taps.ravel()
    frequency, response = freqz(taps, worN=8192, fs=n_steps)
    passed = np.abs(response[frequency <= 0.36])
    # promised: flat within 0.1 %, at least 60 dB down
    assert np.abs(passed - 1.0).max() < 1e-3
    assert 20 * np.log10(np.abs(response[frequency >= 0.64]).max()) < -60.0


def test_filter_is_symmetric_about_the_time_stamp():
    taps = Decimator.design(10).taps.ravel()
    assert taps[0] == 0.0
    # symmetric to the rounding of taps below 0.1
    np.testing.assert_allclose(taps[1:], taps[:0:-1], rtol=0, atol=1e-17)
    assert int(np.argmax(taps)) == HALF_LENGTH_SAMPLES * 10
    # rounding of a sum of some hundred taps
    assert taps.sum() == pytest.approx(1.0, rel=1e-14)


def test_filtered_sine_has_no_lag():
    decimator = Decimator.design(10)
    time = (np.arange(640) - 80).reshape(64, 10) / 10.0
    phase = 2 * math.pi * 0.2 * time + 0.4
    filtered = decimator.apply(np.stack((np.sin(phase), np.cos(phase))))
    at = 2 * math.pi * 0.2 * np.arange(filtered.shape[1]) + 0.4
    # a symmetric filter scales sine and cosine alike: the angle between them stays
    lag = np.arctan2(filtered[0], filtered[1]) - np.arctan2(np.sin(at), np.cos(at))
    np.testing.assert_allclose(np.sin(lag), 0.0, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("period_s", "steps"), [(1e-3, 10), (0.01, 100), (7e-4, 7), (1e-4, 4), (1.05e-3, 11)]
)
def test_motion_is_integrated_at_ten_kilohertz_or_finer(period_s, steps):
    assert steps_per_sample(period_s) == steps


@pytest.mark.parametrize("bits", [8, 12, 14, 16])
def test_codes_keep_to_the_resolution(bits):
    step = 1 << (16 - bits)
    volts = np.linspace(-11.0, 11.0, 5001)
    codes = to_code(volts, 10.0, bits).astype(np.int64)
    assert not (codes % step).any()
    inside = np.abs(volts) < 9.9
    error = codes[inside] * 10.0 / 32768 - volts[inside]
    # half a step, and rounding of one double operation
    assert np.abs(error).max() <= 0.5 * step * 10.0 / 32768 + 1e-12
    assert codes.max() == 32768 - step
    assert codes.min() == -32768


def test_counts_have_no_mean_error_in_either_direction():
    angle = np.linspace(0.0, 400.0, 100_001)
    for sign in (1.0, -1.0):
        counts = to_count(sign * angle, 4000)
        error = counts * (2 * math.pi / 4000) - sign * angle
        # uniform over one count: its mean is known to count / sqrt(12 n) = 1.4e-6 rad, 5 sigma
        assert abs(error.mean()) < 7e-6
        assert np.abs(error).max() <= math.pi / 4000 * (1 + 1e-9)
    assert to_count(np.zeros(1), 4000)[0] == 0
