"""State-space models and samples for the kernel's tests."""

from __future__ import annotations

import numpy as np

from hdbench.filter.statespace import StateBlock, StateSpace

KINDS = ("random-walk", "integrated-random-walk", "ornstein-uhlenbeck", "matern-3/2", "resonance")


def listing(orders=((2.0, 1000.0), (4.0, 1000.0), (0.01, 0.05)), r=1.0):
    blocks = tuple(
        StateBlock(
            "oscillator", "ripple" if o >= 1 else "misalignment", order=o, noise_per_sample=q
        )
        for o, q in orders
    )
    return StateSpace(blocks, r, 1.725e-2, 100.0, 0.005, start="listing")


def slow_block(kind):
    numbers = {
        "random-walk": {"noise_per_s": 0.3},
        "integrated-random-walk": {"noise_per_s": 5.0},
        "ornstein-uhlenbeck": {"variance": 2.0, "time_constant_s": 0.05},
        "matern-3/2": {"variance": 2.0, "time_constant_s": 0.05},
        "resonance": {"variance": 2.0, "time_constant_s": 0.1, "frequency_hz": 3.0},
    }[kind]
    return StateBlock(kind, "slow", prior_variance=2.0, prior_variance_2=50.0, **numbers)


def order_block(order, q=1e-4, prior=1.0, part="ripple"):
    return StateBlock(
        "oscillator",
        part,
        order=order,
        noise_per_rad=q,
        prior_variance=prior,
        prior_variance_2=prior,
    )


def tuned(kind="matern-3/2", *, gate=None, r=2.5e-3):
    blocks = (
        order_block(2.0),
        StateBlock("oscillator", "ripple", frequency_hz=50.0, noise_per_s=1e-3),
        order_block(0.01, 1e-3, 9.0, "misalignment"),
        slow_block(kind),
    )
    return StateSpace(blocks, r, 1.725e-2, 100.0, 0.005, gate_sigma=gate)


def samples(n=1500, seed=1, missing=True):
    """Return time, velocity, torque: uneven, with reversals, standstill, gaps and an outlier."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.7e-3, 1.3e-3, n))
    v = 156.0 * np.sin(2.0 * np.pi * 1.3 * t)
    v[n // 4 : n // 4 + n // 8] = 0.0
    angle = np.concatenate([[0.0], np.cumsum(v[:-1] * np.diff(t))])
    y = 2.0 + 0.4 * np.cos(2.0 * angle + 0.6) + 0.9 * np.cos(angle / 100.0 + 0.3)
    y += rng.normal(0.0, 0.05, n)
    if missing:
        y[n // 2 : n // 2 + 20] = np.nan
        v[n // 2 + 10 : n // 2 + 30] = np.nan
        y[2 * n // 3] += 30.0
        y[3 * n // 4] = np.inf
    return t, v, y
