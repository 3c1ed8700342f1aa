"""Least squares with white and coloured noise."""

from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom
from scipy.stats import t as student

from hdbench.estimation.regression import coloured_fit, ordinary_fit


def ar1(rng: np.random.Generator, n: int, a: float, std: float) -> np.ndarray:
    """Return a stationary AR(1) of given standard deviation."""
    drive = std * np.sqrt(1.0 - a**2) * rng.normal(size=n + 200)
    # 0.9^200 of the start is left: nothing
    return np.asarray(lfilter([1.0], [1.0, -a], drive))[200:]


def sinusoids(n: int) -> np.ndarray:
    angle = 0.11 * np.arange(n)
    return np.column_stack([np.ones(n), np.cos(angle), np.sin(angle)])


def test_ordinary_fit_agrees_with_statsmodels():
    from statsmodels.regression.linear_model import OLS

    rng = np.random.default_rng(1)
    design = np.column_stack([np.ones(50), rng.normal(size=(50, 3)) * [1.0, 1e3, 1e-4]])
    response = design @ [1.0, -2e-3, 5.0, 0.3] + rng.normal(size=50)
    ours, theirs = ordinary_fit(design, response), OLS(response, design).fit()
    # both solve by an orthogonal decomposition of a scaled design: 1e-9 is rounding with margin
    np.testing.assert_allclose(ours.coefficients, theirs.params, rtol=1e-9, atol=0)
    np.testing.assert_allclose(ours.covariance, theirs.cov_params(), rtol=1e-8, atol=1e-18)
    assert ours.dof == theirs.df_resid


def test_missing_samples_do_not_enter():
    rng = np.random.default_rng(2)
    design, noise = sinusoids(80), rng.normal(size=80)
    response = design @ [1.0, 2.0, 3.0] + noise
    holes = np.arange(80) % 7 == 3
    broken = np.where(holes, np.nan, response)
    fit, whole = ordinary_fit(design, broken), ordinary_fit(design[~holes], response[~holes])
    # same sums over the same samples
    np.testing.assert_allclose(fit.coefficients, whole.coefficients, rtol=1e-12, atol=0)
    assert fit.n_samples == int((~holes).sum())
    assert np.isnan(fit.residual[holes]).all()


def test_coloured_fit_agrees_with_generalised_least_squares_at_the_same_colour():
    from statsmodels.regression.linear_model import GLS

    rng = np.random.default_rng(3)
    n = 400
    design = sinusoids(n)
    response = design @ [0.5, 1.0, -1.0] + ar1(rng, n, 0.8, 1.0)
    fit = coloured_fit(design, response, max_order=1)
    a = float(fit.noise.coefficients[0])
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    theirs = GLS(response, design, sigma=a**lag).fit()
    # the same quadratic form, solved through a Cholesky factor there and through prediction here
    np.testing.assert_allclose(fit.coefficients, theirs.params, rtol=1e-9, atol=0)
    np.testing.assert_allclose(fit.covariance, theirs.cov_params(), rtol=1e-8, atol=1e-15)


@cache
def repeated(a):
    """Return by how many standard uncertainties fits of 100 records are off, and their dof."""
    rng = np.random.default_rng(6)
    design, truth = sinusoids(4000), np.array([0.2, 0.4, -0.1])
    fits = [coloured_fit(design, design @ truth + ar1(rng, 4000, a, 0.05)) for _ in range(100)]
    off = [(fit.coefficients - truth) / np.sqrt(np.diag(fit.covariance)) for fit in fits]
    return np.array(off), np.array([[fit.dof] for fit in fits])


def test_covariance_of_coloured_fit_has_the_spread_of_repeated_records():
    off, _ = repeated(0.9)
    # mean of 100 squared normal numbers: std sqrt(2/100) = 0.141; four of them, and 6 % for the
    # covariances being estimates. A fit that takes the noise as white gives 19 for the offset.
    np.testing.assert_allclose((off**2).mean(axis=0), 1.0, rtol=0, atol=0.63)


@pytest.mark.parametrize("a", [pytest.param(0.0, marks=pytest.mark.campaign), 0.9])
def test_intervals_cover_the_truth(a):
    off, dof = repeated(a)
    hits = np.sum(np.abs(off) <= student.ppf(0.975, dof), axis=0)
    # each count is binomial(100, 0.95); false alarm of this test 3 x 2 x 0.0005 = 0.3 %
    low, high = binom.ppf(0.0005, 100, 0.95), binom.ppf(0.9995, 100, 0.95)
    assert np.all((low <= hits) & (hits <= high)), hits


def test_dof_are_those_of_the_density_at_low_frequency():
    rng = np.random.default_rng(7)
    fit = coloured_fit(sinusoids(20_000), ar1(rng, 20_000, 0.9, 1.0), max_order=1)
    # 2 / (2 / n + 4 (1 + a) / (1 - a) / n) = n / 39 at a = 0.9; the coefficient is known to
    # 0.003, which moves (1 + a) / (1 - a) by 3 %; four of them
    assert fit.dof == pytest.approx(20_000 / 39.0, rel=0.13)


def test_a_residual_of_rounding_keeps_the_ordinary_fit():
    design = sinusoids(100)
    fit = coloured_fit(design, design @ [1.0, 2.0, 3.0])
    assert fit.noise is None
    # rounding of 100 sums
    np.testing.assert_allclose(fit.coefficients, [1.0, 2.0, 3.0], rtol=1e-12, atol=0)


@pytest.mark.parametrize(
    ("design", "text"),
    [
        (np.ones((10, 2)), "cannot be told apart"),
        (np.column_stack([np.ones(10), np.zeros(10)]), "column 1 is zero"),
        (np.ones((10, 12)), "need more samples"),
    ],
)
def test_a_design_without_a_solution_is_refused(design, text):
    with pytest.raises(ValueError, match=text):
        ordinary_fit(design, np.arange(10.0))


def test_shapes_that_differ_are_refused_by_their_shapes():
    with pytest.raises(ValueError, match=r"design \(10, 1\) and response \(9,\)"):
        ordinary_fit(np.ones((10, 1)), np.ones(9))
