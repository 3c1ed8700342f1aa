"""A reading counts only when it stands still."""

from __future__ import annotations

import numpy as np

from hdbench.session.settling import settled_reading

BAND_V = 0.003


def test_white_noise_around_a_constant_settles_in_two_windows() -> None:
    rng = np.random.default_rng(1)
    # 3 sigma on the mean and a factor 1.5 on the spread: a false refusal is below 1 % per window
    accepted = sum(
        settled_reading(2.0 + 0.0076 * rng.standard_normal(200), 100, BAND_V) is not None
        for _ in range(200)
    )
    assert accepted >= 190


def test_a_swinging_weight_does_not_settle() -> None:
    rng = np.random.default_rng(2)
    time_s = np.arange(200) * 0.01
    for phase in np.linspace(0.0, 6.0, 13):
        swing = 0.05 * np.cos(2 * np.pi * 0.9 * time_s + phase)
        samples = 2.0 + swing + 0.0076 * rng.standard_normal(200)
        assert settled_reading(samples, 100, BAND_V) is None


def test_creep_faster_than_the_band_does_not_settle() -> None:
    rng = np.random.default_rng(3)
    samples = 2.0 + 0.02 * np.arange(200) * 0.01 + 0.0005 * rng.standard_normal(200)
    assert settled_reading(samples, 100, BAND_V) is None


def test_too_few_samples_are_no_reading() -> None:
    assert settled_reading(np.ones(199), 100, BAND_V) is None
