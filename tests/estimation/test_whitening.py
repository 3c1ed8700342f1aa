"""Coloured noise as an autoregression."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from hdbench.estimation import harmonics
from hdbench.estimation.regression import fit_noise, run_positions, whiten


def coloured(seed: int, n: int, poles: tuple[float, ...]) -> np.ndarray:
    drive = np.random.default_rng(seed).normal(size=n + 500)
    return np.asarray(lfilter([1.0], np.poly(poles), drive))[500:]


def test_coefficients_agree_with_statsmodels_burg():
    from statsmodels.regression.linear_model import burg

    series = coloured(1, 3000, (0.9, -0.5, 0.3))
    model = fit_noise(series, max_order=3)
    rho, _ = burg(series, order=3, demean=False)
    assert model.order == 3
    # the same recursion; rounding of 3000 products
    np.testing.assert_allclose(model.coefficients, rho, rtol=1e-9, atol=0)
    lagged = np.column_stack([series[2:-1], series[1:-2], series[:-3]])
    error = series[3:] - lagged @ rho
    # Burg's error power is the mean over both directions of time: they differ by 3 / n at the ends
    assert model.innovation_std**2 == pytest.approx(float(np.mean(error**2)), rel=5e-3)


def test_bic_finds_the_order_of_a_known_process():
    orders = [fit_noise(coloured(seed, 4000, (0.8, 0.5))).order for seed in range(20)]
    # BIC adds a parameter with probability P(chi2_1 > ln 4000 = 8.3) = 0.4 % per further order:
    # more than 3 of 20 records with any of the next few is below 1e-4
    assert sum(order != 2 for order in orders) <= 3


def test_white_noise_has_order_zero():
    assert fit_noise(coloured(3, 5000, ())).order == 0


def density(model, frequency_hz, period_s):
    """Return the one-sided power spectral density of a noise model, by its definition."""
    lags = np.arange(1, model.order + 1)
    turn = np.exp(-2j * np.pi * period_s * np.multiply.outer(frequency_hz, lags))
    return 2.0 * period_s * model.innovation_std**2 / np.abs(1.0 - turn @ model.coefficients) ** 2


def test_spectrum_is_that_of_the_process():
    model = fit_noise(coloured(4, 100_000, (0.9,)))
    frequency = np.array([0.0, 50.0, 200.0, 500.0])
    turn = np.exp(-2j * np.pi * frequency * 1e-3)
    expected = 2e-3 / np.abs(1.0 - 0.9 * turn) ** 2
    # the coefficient has std sqrt((1 - 0.9^2) / n) = 0.0014, the logarithm of the density at 0 Hz
    # follows it by 2 / (1 - 0.9) = 20: 2.8 %; four of them
    np.testing.assert_allclose(density(model, frequency, 1e-3), expected, rtol=0.11, atol=0)


def test_density_variance_of_a_first_order_process_has_its_closed_form():
    model = fit_noise(coloured(4, 50_000, (0.9,)), max_order=1)
    a = float(model.coefficients[0])
    # at zero frequency: (2 / (1 - a))^2 (1 - a^2) / n
    expected = 4.0 * (1.0 + a) / (1.0 - a) / 50_000
    # stds[0] is the measured power, not the model's std^2 / (1 - a^2): they differ by 1 / n
    assert model.density_variance == pytest.approx(expected, rel=1e-3)


def test_whitening_equals_the_cholesky_factor_of_the_covariance():
    model = fit_noise(coloured(5, 2000, (0.9,)), max_order=1)
    a, std = float(model.coefficients[0]), model.innovation_std
    n = 40
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    factor = np.linalg.cholesky(std**2 / (1.0 - a**2) * a**lag)
    columns = np.random.default_rng(6).normal(size=(n, 2))
    # both divide by the same factor; rounding of a well conditioned triangle
    np.testing.assert_allclose(
        whiten(columns, model), np.linalg.solve(factor, columns), rtol=1e-9, atol=1e-12
    )


def test_a_gap_splits_the_record():
    series = coloured(7, 1000, (0.9, 0.4))
    model = fit_noise(series)
    valid = np.ones(1000, dtype=bool)
    valid[400:430] = False
    white = whiten(np.where(valid, series, np.nan), model, valid)
    apart = np.concatenate([whiten(series[:400], model), np.zeros(30), whiten(series[430:], model)])
    # the same operations on the same numbers
    np.testing.assert_allclose(white, apart, rtol=1e-12, atol=1e-12)


def test_a_new_stretch_starts_anew():
    series = coloured(8, 300, (0.9,))
    model = fit_noise(series)
    starts = np.zeros(300, dtype=bool)
    starts[120] = True
    white = whiten(series, model, starts=starts)
    apart = np.concatenate([whiten(series[:120], model), whiten(series[120:], model)])
    # the same operations on the same numbers
    np.testing.assert_allclose(white, apart, rtol=1e-12, atol=1e-12)


def test_run_positions_count_within_runs():
    valid = np.array([1, 1, 0, 1, 1, 1], dtype=bool)
    starts = np.array([0, 0, 0, 0, 0, 1], dtype=bool)
    assert run_positions(valid, starts).tolist() == [0, 1, -1, 0, 1, 0]


def test_whitened_noise_is_white():
    series = coloured(9, 20_000, (0.95, 0.6, -0.7))
    white = whiten(series, fit_noise(series))
    lags = np.array([white[k:] @ white[:-k] for k in range(1, 21)]) / (white @ white)
    # Portmanteau statistic against its chi-square distribution; false alarm 1e-3
    assert len(white) * float((lags**2).sum()) < chi2.ppf(0.999, 20)


def test_a_strong_line_is_not_swallowed_by_the_noise_model(monkeypatch):
    noise = coloured(10, 20_000, (0.9,))
    line = 5.0 * np.cos(0.123 * np.arange(20_000) + 1.0)
    kept, clean = fit_noise(noise + line), fit_noise(noise)
    monkeypatch.setattr(harmonics, "without_lines", lambda residual, _: residual)
    swallowed = fit_noise(noise + line)
    at_line = np.array([0.123 / (2.0 * np.pi)])
    there, beside, taken = (float(density(m, at_line, 1.0)[0]) for m in (kept, clean, swallowed))
    # what is left of the line after it is fitted out is below one standard deviation of its
    # amplitude; 20 % of the density there is far above that and far below the line
    assert there == pytest.approx(beside, rel=0.2)
    assert taken > 3.0 * beside


def test_a_record_of_zeros_is_refused():
    with pytest.raises(ValueError, match="not all zero"):
        fit_noise(np.zeros(100))
