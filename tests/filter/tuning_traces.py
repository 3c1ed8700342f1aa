"""Traces and a plain Kalman filter for the tests of tuning: no code of the product."""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from kernel_models import filter_model, order_block

from hdbench.filter import Channels, SlowBlock
from hdbench.filter.kalman import kernel_form


def needs_compiled_kernel():
    """Skip where the likelihood would run in Python: a hundred times slower."""
    try:
        kernel_form("c")
    except ValueError:
        pytest.skip("the C kernel was not compiled here")


def campaign():
    """Return tools/tuning_campaign.py as a module."""
    name = "tuning_campaign"
    if name not in sys.modules:
        path = Path(__file__).parents[2] / "tools" / f"{name}.py"
        spec = importlib.util.spec_from_file_location(name, path)
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


def channels(t, v, y, angle=None, source="test.csv"):
    return Channels(t, v, y, angle, source)


def turning(duration_s=8.0, *, noise=0.05, seed=0, slow=0.5, low=40.0, high=160.0, period=1e-3):
    """Return time, velocity, angle, torque: speed swings twice, slow torque of 0.1 s memory."""
    rng = np.random.default_rng(seed)
    n = round(duration_s / period)
    t = np.arange(n) * period
    mean, swing = 0.5 * (low + high), 0.5 * (high - low)
    v = mean - swing * np.cos(4.0 * math.pi * t / duration_s)
    angle = np.concatenate([[0.0], np.cumsum(v[:-1] * np.diff(t))])
    y = 1.2 * np.cos(2 * angle + 0.6) + 0.6 * np.cos(4 * angle - 1.1)
    y += 3.0 * np.cos(angle / 100 + 0.3) + rng.normal(0.0, noise, n)
    decay, x = math.exp(-period / 0.1), rng.normal()
    for k, kick in enumerate(rng.normal(0.0, math.sqrt(1.0 - decay**2), n)):
        y[k] += slow * x
        x = decay * x + kick
    return t, v, angle, y


def dense_log_likelihood(t, turn, y, oscillators, slow, r):
    """Gaussian log-likelihood by the textbook's dense recursion.

    `oscillators`: (order, q per radian, prior variance); `slow`: (drift matrix, stationary or
    prior covariance, diffusion per second or None for a stationary block). First states are seen.
    """
    from scipy.linalg import block_diag, expm

    n = 2 * len(oscillators)
    priors = [np.eye(2) * p for _, _, p in oscillators] + [p for _, p, _ in slow]
    covariance = block_diag(*priors)
    c = np.zeros(len(covariance))
    c[0:n:2] = 1.0
    at = n
    for drift, _, _ in slow:
        c[at] = 1.0
        at += len(drift)
    x, total = np.zeros(len(c)), 0.0
    for k in range(len(t)):
        if k:
            dt = t[k] - t[k - 1]
            parts, noises = [], []
            for order, q, _ in oscillators:
                a = order * turn[k]
                parts.append(np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]))
                noises.append(np.eye(2) * q * abs(turn[k]))
            for drift, prior, diffusion in slow:
                f = expm(drift * dt)
                parts.append(f)
                noises.append(prior - f @ prior @ f.T if diffusion is None else diffusion * dt)
            f, q = block_diag(*parts), block_diag(*noises)
            x, covariance = f @ x, f @ covariance @ f.T + q
        if not np.isfinite(y[k]):
            continue
        s = r + c @ covariance @ c
        e = y[k] - c @ x
        total -= 0.5 * (math.log(2.0 * math.pi * s) + e * e / s)
        gain = covariance @ c / s
        x = x + gain * e
        covariance = covariance - np.outer(gain, gain) * s
    return total


def tuned_like(q_output=1e-7):
    """Return a model as a tuning makes them."""
    output = order_block(0.01, q_output, "misalignment")
    return filter_model(
        (order_block(2.0, 1e-7), order_block(4.0, 1e-7), output),
        0.0025,
        angle=True,
        slow=(
            SlowBlock("random-walk", noise_per_s=1e-3),
            SlowBlock("resonance", variance=4.0, time_constant_s=0.11, frequency_hz=2.0),
        ),
        order_prior_std_nm=4.0,
        slow_prior_std_nm=40.0,
    )
