"""Properties for every trace and model, and two oracles that share no code with the kernel."""

import numpy as np
import pytest
from kernel_models import KINDS, new_state, run, samples, smooth, tuned
from numpy.testing import assert_allclose
from scipy.linalg import block_diag, expm


def drift(block, dt):
    """Return F and Q of a slow block by the matrix exponential (Van Loan)."""
    rate = 1.0 / (block.time_constant_s or 1.0)
    w2 = rate**2 if block.kind == "matern-3/2" else (2.0 * np.pi * block.frequency_hz) ** 2
    turning = [[0.0, 1.0], [-w2, -2.0 * rate]], [0.0, 4.0 * rate * w2 * block.variance]
    a, density = {
        "random-walk": ([[0.0]], [block.noise_per_s]),
        "integrated-random-walk": ([[0.0, 1.0], [0.0, 0.0]], [0.0, block.noise_per_s]),
        "ornstein-uhlenbeck": ([[-rate]], [2.0 * block.variance * rate]),
    }.get(block.kind, turning)
    a, n = np.array(a), len(a)
    both = expm(np.block([[-a, np.diag(density)], [np.zeros((n, n)), a.T]]) * dt)
    f = both[n:, n:].T
    return f, f @ both[:n, n:]


def matrices(model, t, v):
    """Return F and Q into every sample, C, and the prior variances, with dense matrices."""
    steps = []
    for k in range(1, t.size):
        dt, turn = t[k] - t[k - 1], v[k - 1] * (t[k] - t[k - 1])
        parts = []
        for b in model.blocks:
            a = b.order * turn + 2.0 * np.pi * b.frequency_hz * dt
            f = np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
            grown = {"sample": 1.0, "motor-radian": abs(turn), "second": dt}[b.noise_per]
            parts.append((f, b.process_noise * grown * np.eye(2)))
        parts += [drift(b, dt) for b in model.slow]
        steps.append(tuple(block_diag(*(p[i] for p in parts)) for i in range(2)))
    c, prior = [1.0, 0.0] * len(model.blocks), [model.order_prior_std_nm**2] * 2 * len(model.blocks)
    for b in model.slow:
        c += [1.0] + [0.0] * (b.n_states - 1)
        first = b.variance or model.slow_prior_std_nm**2
        own = 2.0 * np.pi * b.frequency_hz or 1.0 / (b.time_constant_s or 1.0)
        prior += [first, b.variance * own**2 or first][: b.n_states]
    return steps, np.array(c), np.array(prior)


def held(v):
    """Hold the last velocity where one is missing."""
    v = v.copy()
    for k in np.flatnonzero(np.isnan(v)):
        v[k] = v[k - 1]
    return v


def normal_equations(model, t, v, y):
    """Return matrix and right side of x_0 ~ prior, x_k - F x_(k-1) ~ Q, y - C x ~ R."""
    steps, c, prior = matrices(model, t, held(v))
    n, m = t.size, c.size
    change = np.eye(n * m)
    for k, (f, _) in enumerate(steps):
        change[(k + 1) * m : (k + 2) * m, k * m : (k + 1) * m] = -f
    weight = block_diag(np.diag(1.0 / prior), *(np.linalg.inv(q) for _, q in steps))
    used = (np.abs(y) < 1e12) & np.isfinite(v)
    seen = np.kron(np.diag(1.0 * used), c)
    whole = change.T @ (0.5 * (weight + weight.T)) @ change
    whole += seen.T @ seen / model.measurement_noise
    return whole, seen.T @ np.where(used, y, 0.0) / model.measurement_noise, m


def turning(n, seed):
    """Samples 20 ms apart (Q of a walk's two states loses digits as dt^-3), the axis never at rest.

    A resting axis has Q = 0, which normal equations cannot hold.
    """
    t, _, y = samples(n, seed)
    t = 20.0 * t
    v = 6.0 + 4.0 * np.sin(0.5 * t)
    v[n // 2 + 10 : n // 2 + 30] = np.nan
    return t, v, y


@pytest.mark.parametrize("kind", KINDS)
def test_the_smoother_is_the_solution_of_the_normal_equations(kind):
    t, v, y = turning(120, seed=3)
    model = tuned(kind, inertia=0.0)
    whole, right, m = normal_equations(model, t, v, y)
    wanted = np.linalg.solve(whole, right).reshape(-1, m)
    variance = np.diagonal(np.linalg.inv(whole)).reshape(-1, m)
    found, at = smooth(model, t, v, y), 0
    for i, n_states in enumerate([2, 2, 2, model.slow[0].n_states]):
        # 1e-9 is what is asked for, on torques of some N m
        assert_allclose(found.mean[:, i, 0], wanted[:, at], rtol=0.0, atol=1e-9)
        # variances by inverting a matrix of condition 1e10 or so
        assert_allclose(found.covariance[:, i, 0], variance[:, at], rtol=1e-5)
        at += n_states


@pytest.mark.parametrize("kind", KINDS)
def test_the_likelihood_is_that_of_statsmodels(kind):
    statespace = pytest.importorskip("statsmodels.tsa.statespace.kalman_filter")
    t, v, y = samples(300, seed=5)
    model = tuned(kind, inertia=0.0)
    steps, c, prior = matrices(model, t, held(v))
    m = c.size
    y = np.where((np.abs(y) < 1e12) & np.isfinite(v), y, np.nan)
    kf = statespace.KalmanFilter(k_endog=1, k_states=m, k_posdef=m)
    kf.bind(y.copy())
    kf["design"] = c[None, :]
    kf["obs_cov"] = np.array([[model.measurement_noise]])
    kf["selection"] = np.eye(m)
    last = (np.eye(m), np.zeros((m, m)))  # out of the last sample: not used
    kf["transition"] = np.stack([f for f, _ in (*steps, last)], axis=2)
    kf["state_cov"] = np.stack([q for _, q in (*steps, last)], axis=2)
    kf.initialize_known(np.zeros(m), np.diag(prior))
    found = run(model, new_state(model), t, v, y)
    # 1e-8 relative is what is asked for
    assert found.log_likelihood == pytest.approx(kf.loglike(), rel=1e-8)
    assert found.n_used == np.isfinite(y).sum()
