"""Moments of a joint fit against dense least squares and dense Gaussian likelihoods."""

from itertools import pairwise

import numpy as np
import pytest
from discovery_records import fitted, swinging
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from hdbench.diagnosis.discovery.moments import Moments, packed, quick_likelihood, solve
from hdbench.diagnosis.discovery.refine import log_evidence
from hdbench.diagnosis.discovery.spectrum import Spectrum, make_shapes

EDGES = np.array([0, 7, 20, 44, 80])
COUNTS = np.diff(EDGES).astype(float)
POWER = np.array([9.0, 4.0, 1.0, 0.25])
NOISE = np.repeat(POWER, np.diff(EDGES))
SPECTRUM = Spectrum(POWER, np.zeros(0))
SHAPES = make_shapes(np.array([1.0, 3.0, 8.0, 20.0]), 1e-9)


def banded(one, other):
    return np.stack([one[:, a:b] @ other[:, a:b].T for a, b in pairwise(EDGES)])


def moments_of(rows, measured, coefficients, penalty, expected=None):
    left = measured - coefficients @ rows
    return Moments(
        packed(banded(rows, rows), np.arange(len(rows))),
        banded(left[None, :], rows)[:, 0],
        banded(left[None, :], left[None, :])[:, 0, 0],
        COUNTS,
        coefficients,
        penalty,
        np.zeros(len(rows)) if expected is None else expected,
        np.zeros(len(rows), dtype=bool),
        np.zeros(len(COUNTS)),
    )


def solved(*case):
    return solve(moments_of(*case), SHAPES, SPECTRUM, rounds=0)


@pytest.fixture(name="case")
def drawn():
    rng = np.random.default_rng(11)
    rows = rng.standard_normal((5, 80))
    measured = np.array([1.0, -2.0, 0.5, 0.0, 3.0]) @ rows
    return rows, measured + np.sqrt(NOISE) * rng.standard_normal(80), rng.standard_normal(5)


def same(one, other):
    for name in ("products", "right", "power", "coefficients", "penalty", "expected"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-9)


def test_enlarged_moments_are_those_of_all_columns(case):
    rows, measured, coefficients = case
    few = moments_of(rows[:3], measured, coefficients[:3], np.zeros(3))
    left = measured - coefficients[:3] @ rows[:3]
    right = banded(left[None, :], rows[3:])[:, 0]
    more = few.enlarged(banded(rows[3:], rows[:3]), banded(rows[3:], rows[3:]), right)
    start = np.concatenate([coefficients[:3], [0.0, 0.0]])
    same(more, moments_of(rows, measured, start, np.zeros(5)))


@pytest.mark.parametrize("dropped", [[], [1], [0, 3]])
def test_moments_of_some_rows_of_a_fit_are_those_of_a_fit_without_the_others(dropped):
    fit = fitted(swinging(3000))
    kept = np.setdiff1d(np.arange(len(fit.rows)), dropped)
    few = fit.copy()
    few.keep(np.isin(np.arange(len(fit.rows)), kept))
    same(fit.moments(kept), few.moments())


def test_products_of_sums_of_rows_are_sums_of_products():
    beside = fitted(swinging(3000)).beside()
    rng = np.random.default_rng(5)
    rows, mix = rng.standard_normal((4, beside.bands.size)), rng.standard_normal((4, 2))
    found, wanted = beside.products(rows).mixed(mix), beside.products(mix.T @ rows)
    for name in ("cross", "own", "right"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), atol=1e-9)


def test_a_row_beside_a_fit_is_what_weighted_least_squares_leave_of_it():
    fit = fitted(swinging(3000))
    without = fit.beside(0)
    row, white = fit.rows[:1], np.sqrt(without.whitening)
    others = (fit.rows[fit.owner != 0] * white).T
    left = row[0] * white - others @ np.linalg.lstsq(others, row[0] * white, rcond=None)[0]
    information, right = without.project(row)
    # the misalignment has a prior, and all have a ridge
    assert information[0, 0] == pytest.approx(left @ left, rel=1e-4)
    assert right[0] == pytest.approx(left @ (without.residual * white), rel=0.01)


def test_the_solution_is_that_of_weighted_least_squares(case):
    rows, measured, coefficients = case
    found = solved(rows, measured, coefficients, np.zeros(5))
    wanted = np.linalg.lstsq((rows / np.sqrt(NOISE)).T, measured / np.sqrt(NOISE), rcond=None)[0]
    np.testing.assert_allclose(coefficients + found.step, wanted, rtol=1e-7)
    left = (measured - wanted @ rows) / np.sqrt(NOISE)
    assert found.likelihood == pytest.approx(-0.5 * float(np.log(NOISE).sum() + left @ left))


def test_the_evidence_of_form_errors_is_a_dense_gaussian_likelihood(case):
    rows, measured, coefficients = case
    spread = np.array([0.7, 2.0, 0.05, 1.3, 0.4])
    mean = np.array([0.5, 0.0, -1.0, 0.0, 2.0])
    found = solved(rows, measured, coefficients, 1.0 / spread**2, mean)
    covariance = np.diag(NOISE) + rows.T @ np.diag(spread**2) @ rows
    wanted = multivariate_normal(mean @ rows, covariance).logpdf(measured)
    constant = -0.5 * 80 * np.log(2.0 * np.pi)
    assert found.likelihood == pytest.approx(wanted - constant, abs=1e-6)


def test_free_columns_beside_form_errors_are_fitted_at_no_cost(case):
    rows, measured, coefficients = case
    free, form = rows[:2], rows[2:]
    spread = np.array([0.05, 1.3, 0.4])
    penalty = np.concatenate([[0.0, 0.0], 1.0 / spread**2])
    found = solved(rows, measured, coefficients, penalty).likelihood
    covariance = np.diag(NOISE) + form.T @ np.diag(spread**2) @ form
    inverse = np.linalg.inv(covariance)
    info = free @ inverse @ free.T
    best = np.linalg.solve(info, free @ inverse @ measured)
    left = measured - best @ free
    # restricted likelihood, less what the free columns alone would have
    alone = (free / NOISE) @ free.T
    wanted = -0.5 * (
        np.linalg.slogdet(covariance)[1]
        + left @ inverse @ left
        + np.linalg.slogdet(info)[1]
        - np.linalg.slogdet(alone)[1]
    )
    assert found == pytest.approx(float(wanted), abs=1e-6)


def test_a_column_that_is_empty_takes_nothing(case):
    rows, measured, _ = case
    rows = np.concatenate([rows[:2], np.zeros((1, 80))])
    found = solved(rows, measured, np.zeros(3), np.zeros(3))
    assert found.step[2] == 0.0
    alone = solved(rows[:2], measured, np.zeros(2), np.zeros(2))
    assert found.likelihood == pytest.approx(alone.likelihood)


@pytest.mark.parametrize("statistic", [0.5, 12.0, 300.0])
def test_log_evidence_of_one_amplitude_is_the_integral_over_its_prior(statistic):
    # amplitude z in standard deviations, prior N(0, g); weak effects within e^2 of them
    g = max(np.exp(4.0), statistic - 1.0)
    z = np.sqrt(statistic)

    def ratio(a):
        return np.exp(-0.5 * (z - a) ** 2 - 0.5 * a * a / g) / np.sqrt(2.0 * np.pi * g)

    integral = quad(ratio, z - 12.0, z + 12.0, epsabs=1e-14, epsrel=1e-10)[0]
    assert log_evidence(statistic, 1) == pytest.approx(np.log(integral) + 0.5 * statistic, abs=1e-6)


def test_nothing_has_no_evidence():
    assert log_evidence(0.0, 0) == -np.inf


@pytest.mark.parametrize("dof", [2, 5])
def test_log_evidence_of_several_amplitudes_is_a_ratio_of_gaussian_densities(dof):
    z = np.random.default_rng(dof).standard_normal(dof) * 9.0
    statistic = float(z @ z)
    g = max(np.exp(4.0), statistic / dof - 1.0)
    with_it = multivariate_normal(np.zeros(dof), (1.0 + g) * np.eye(dof)).logpdf(z)
    without = multivariate_normal(np.zeros(dof), np.eye(dof)).logpdf(z)
    assert log_evidence(statistic, dof) == pytest.approx(with_it - without)


@pytest.mark.parametrize("dropped", [[], [4], [3, 4]])
def test_quick_likelihoods_differ_as_those_of_a_fit_in_one_noise(case, dropped):
    rows, measured, coefficients = case
    penalty = np.array([0.0, 0.0, 0.0, 0.8, 4.0])
    weighted, right = rows / NOISE @ rows.T, rows / NOISE @ measured

    def both(kept):
        full = solved(rows[kept], measured, coefficients[kept], penalty[kept])
        return quick_likelihood(weighted, right, penalty, kept), full.likelihood

    quick, full = both(~np.isin(np.arange(5), dropped))
    first_quick, first_full = both(np.array([True, True, True, True, False]))
    np.testing.assert_allclose(quick - first_quick, full - first_full, atol=1e-6)
