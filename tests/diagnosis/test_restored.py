"""Power at 0 Hz that slow columns took with them is given back to the noise model."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from hdbench.diagnosis.noise.restored import restored
from hdbench.estimation import fit_noise

N, COLUMNS = 8000, 60


def left_of_slow_columns(coefficients: tuple[float, ...], seed: int) -> np.ndarray:
    """Return an autoregression without its projection on cosines over half cycles."""
    white = np.random.default_rng(seed).standard_normal(N + 500)
    noise = lfilter([1.0], [1.0, *(-a for a in coefficients)], white)[500:]
    at = (np.arange(N) + 0.5) / N
    basis = np.cos(np.pi * np.outer(at, np.arange(COLUMNS)))
    basis /= np.linalg.norm(basis, axis=0)
    return noise - basis @ (basis.T @ noise)


@pytest.mark.parametrize("coefficients", [(0.9,), (0.6,), (1.2, -0.4)])
def test_the_power_at_0_hz_is_that_of_the_whole_noise(coefficients):
    true = 1.0 / (1.0 - sum(coefficients)) ** 2
    plain, given = [], []
    for seed in range(12):
        model = fit_noise(left_of_slow_columns(coefficients, seed), max_order=len(coefficients))
        back = restored(model, COLUMNS / N)
        for powers, one in ((plain, model), (given, back)):
            powers.append((one.innovation_std / (1.0 - one.coefficients.sum())) ** 2 / true)
    # four standard errors of the mean of twelve: right code leaves them once in 16 000
    error = 4.0 * np.std(given, ddof=1) / np.sqrt(len(given))
    assert abs(np.mean(given) - 1.0) < error
    assert np.mean(plain) < np.mean(given)


def test_nothing_taken_out_changes_nothing():
    model = fit_noise(left_of_slow_columns((1.2, -0.4), 1), max_order=5)
    same = restored(model, 0.0)
    np.testing.assert_allclose(same.coefficients, model.coefficients, atol=1e-12)
    np.testing.assert_allclose(same.stds, model.stds, rtol=1e-12)
