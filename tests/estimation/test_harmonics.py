"""Amplitudes, phases and combined uncertainties."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom
from scipy.stats import t as student

from hdbench.estimation.harmonics import combine, harmonic_at, harmonic_columns, scaled
from hdbench.estimation.regression import ordinary_fit
from hdbench.records import Quantity


@given(st.floats(0.01, 100.0), st.floats(-3.1, 3.1), st.floats(0.1, 9.0))
def test_amplitude_and_phase_are_put_back(amplitude, phase, order):
    angle = np.linspace(0.0, 60.0, 400)
    signal = amplitude * np.cos(order * angle + phase)
    found = harmonic_at(ordinary_fit(harmonic_columns(angle, [order]), signal), 0)
    # rounding of 400 products, divided by the smallest sine and cosine energy of the range
    assert found.amplitude.value == pytest.approx(amplitude, rel=1e-9)
    assert math.remainder(found.phase.value - phase, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_uncertainties_are_those_of_the_cramer_rao_bound():
    n, std = 10_000, 0.05
    angle = np.linspace(0.0, 400.0, n)
    noise = std * np.random.default_rng(1).normal(size=n)
    signal = 0.4 * np.cos(2.0 * angle + 0.6) + noise
    found = harmonic_at(ordinary_fit(harmonic_columns(angle, [2.0]), signal), 0)
    # std estimated from 10 000 samples: 0.7 %; four of them
    assert found.amplitude.std == pytest.approx(std * math.sqrt(2.0 / n), rel=0.03)
    assert found.phase.std == pytest.approx(std * math.sqrt(2.0 / n) / 0.4, rel=0.03)


def test_an_amplitude_within_the_noise_says_so():
    angle = np.linspace(0.0, 400.0, 2000)
    noise = np.random.default_rng(2).normal(size=2000)
    found = harmonic_at(ordinary_fit(harmonic_columns(angle, [2.0]), noise), 0)
    assert found.small
    # a phase known to nothing is uniform over a turn: std pi / sqrt(3)
    assert found.phase.std <= math.pi / math.sqrt(3.0)
    assert found.amplitude.std == pytest.approx(math.sqrt(2.0 / 2000), rel=0.1)


def test_a_known_part_alone_stays_known():
    assert combine((3.0, None), (4.0, None)) == (5.0, None)


@given(st.floats(1.0, 200.0))
def test_one_part_keeps_its_dof(dof):
    std, combined = combine((0.7, dof), (0.0, None))
    # a sum of squares and its root: rounding
    assert std == pytest.approx(0.7, rel=1e-12)
    # the inverse of Student's t in its dof is solved to about 1e-8
    assert combined == pytest.approx(dof, rel=1e-5)


@given(st.floats(1e-3, 1e3), st.floats(1.0, 60.0), st.floats(1.0, 60.0))
def test_interval_is_the_root_sum_of_squares_of_the_intervals(ratio, dof_1, dof_2):
    std, dof = combine((1.0, dof_1), (ratio, dof_2))
    assert dof is not None
    expected = math.hypot(student.ppf(0.975, dof_1), ratio * student.ppf(0.975, dof_2))
    # the inverse in dof is solved to 1e-8, the quantile moves less than that
    assert std * student.ppf(0.975, dof) == pytest.approx(expected, rel=1e-5)
    assert min(dof_1, dof_2) * (1.0 - 1e-5) <= dof


@pytest.mark.parametrize("ratio", [0.05, 0.3, 1.0])
def test_intervals_of_a_gain_with_three_dof_beside_noise_cover(ratio):
    rng = np.random.default_rng(3)
    n_runs = 3000
    error = rng.normal(size=n_runs) + ratio * rng.normal(size=n_runs)
    gain_std = np.sqrt(rng.chisquare(3, n_runs) / 3.0)
    hits = 0
    for k in range(n_runs):
        low, high = scaled(Quantity(1.0, ratio, 1e4), float(gain_std[k]), 3.0).interval()
        hits += low <= 1.0 + error[k] <= high
    # at least 95 %, at most 97.5 %; false alarm 1e-3 on either side
    assert binom.ppf(0.001, n_runs, 0.95) <= hits <= binom.ppf(0.999, n_runs, 0.975)
