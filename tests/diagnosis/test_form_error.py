"""Evidence with form error against dense Gaussian laws and draws."""

import numpy as np
import pytest

from hdbench.diagnosis.evidence import (
    marginal_nats,
    orthonormal,
    probabilities,
    rivals,
    share_p_value,
    sine_squared,
)


def dense_nats(left, forms, variance):
    """Log density of a normal law, less its constant."""
    covariance = variance * np.eye(len(left)) + forms @ forms.T
    quad = left @ np.linalg.solve(covariance, left)
    return -0.5 * (np.linalg.slogdet(covariance)[1] + quad)


def test_the_marginal_likelihood_is_that_of_the_dense_law():
    rng = np.random.default_rng(1)
    forms = rng.standard_normal((40, 3)) * np.array([3.0, 0.1, 1e-6])
    left = forms @ rng.standard_normal(3) + 0.2 * rng.standard_normal(40)
    nats, variance = marginal_nats(left, forms, 40, 0.0)
    assert nats == pytest.approx(dense_nats(left, forms, variance), abs=1e-6)
    # no other noise is likelier by more than the step of the search
    others = [dense_nats(left, forms, v) for v in np.geomspace(1e-3, 1.0, 400)]
    assert max(others) < nats + 0.01


def test_a_form_error_explains_what_lies_along_it_and_costs_where_nothing_does():
    rng = np.random.default_rng(2)
    along = np.zeros((30, 1))
    along[0] = 5.0
    quiet = 0.1 * rng.standard_normal(30)
    loud = quiet + 4.0 * np.eye(30)[0]
    none = np.zeros((30, 0))
    assert marginal_nats(loud, along, 30, 0.0)[0] > marginal_nats(loud, none, 30, 0.0)[0] + 20.0
    assert marginal_nats(quiet, along, 30, 0.0)[0] < marginal_nats(quiet, none, 30, 0.0)[0] - 2.0


def test_the_share_of_noise_along_directions_has_the_law_of_draws():
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((20_000, 12)) ** 2
    share = noise[:, :2].sum(axis=1) / noise.sum(axis=1)
    # 1000 of 20 000 lie beyond the 95 % quantile: three standard deviations are a tenth
    assert share_p_value(float(np.quantile(share, 0.95)), 2, 12) == pytest.approx(0.05, rel=0.1)


def test_names_of_one_table():
    table = {"a": 10.0, "b": 8.0, "c": 6.0}
    assert rivals(table, "a") == ("b",)
    assert sum(probabilities(table).values()) == pytest.approx(1.0)


def test_spans_do_not_depend_on_scale_or_order():
    rng = np.random.default_rng(4)
    columns = rng.standard_normal((20, 3))
    first = orthonormal(columns * np.array([1e-6, 1.0, 1e6]))
    second = orthonormal(np.hstack([columns[:, ::-1], columns[:, :1] + columns[:, 1:2]]))
    assert first.shape[1] == second.shape[1] == 3
    assert sine_squared(first, second) < 1e-9
