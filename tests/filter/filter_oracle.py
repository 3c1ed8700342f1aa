"""Equations 5-10 of the report as they stand, with dense matrices: no code of the product."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Bench:
    """Numbers of the report: J_load, gear ratio, differentiator, R."""

    inertia: float = 1.725e-2
    ratio: float = 100.0
    constant: float = 0.005
    r: float = 1.0


def expected_torque(t, v, bench=Bench()):
    """Tustin of s / (T s + 1) with the local period, started at the first velocity."""
    a = np.zeros(len(t))
    for k in range(1, len(t)):
        dt = t[k] - t[k - 1]
        two_t = 2 * bench.constant
        a[k] = 2 / (two_t + dt) * (v[k] - v[k - 1]) + (two_t - dt) / (two_t + dt) * a[k - 1]
    return bench.inertia * a / bench.ratio


def literal(t, v, y, orders, q, bench=Bench(), angle=None, use=None):
    """Predictions per block, shape (n, blocks); `use` False predicts only; all NaN-free."""
    n, nb = len(t), len(orders)
    residual = y - expected_torque(t, v, bench)
    use = np.ones(n, bool) if use is None else use
    C = np.zeros((1, 2 * nb))
    C[0, ::2] = 1.0
    Q = np.diag(np.repeat(np.asarray(q, float), 2))
    P = np.eye(2 * nb)
    x = np.zeros((2 * nb, 1))
    x[::2, 0] = residual[0]
    out = np.zeros((n, nb))
    for k in range(n):
        if k:
            out[k] = x[::2, 0]
        if k + 1 == n:
            break
        turn = v[k] * (t[k + 1] - t[k]) if angle is None else angle[k + 1] - angle[k]
        Phi = np.zeros((2 * nb, 2 * nb))
        for i, order in enumerate(orders):
            w = order * turn
            Phi[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [
                [np.cos(w), np.sin(w)],
                [-np.sin(w), np.cos(w)],
            ]
        if use[k]:
            K = Phi @ P @ C.T @ np.linalg.inv(bench.r + C @ P @ C.T)
            x = Phi @ x + K @ (residual[k] - C @ x).reshape(1, 1)
            P = Q + (Phi - K @ C) @ P @ Phi.T
        else:
            x = Phi @ x
            P = Q + Phi @ P @ Phi.T
    return out


def motion(n=4000, seed=1):
    """Return time, velocity, torque: uneven sampling, both directions, reversals, standstill."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.7e-3, 1.3e-3, n))
    v = 156 * np.sin(2 * np.pi * 0.9 * t)
    v[n // 4 : n // 4 + n // 8] = 0.0
    v[n // 2 :] *= -0.5
    angle = np.concatenate([[0.0], np.cumsum(v[:-1] * np.diff(t))])
    y = 2.0 + 0.4 * np.cos(2 * angle + 0.6) + 0.2 * np.cos(4 * angle - 1.1)
    y += 0.9 * np.cos(angle / 100 + 0.3) + rng.normal(0, 0.05, n)
    return t, v, y, angle
