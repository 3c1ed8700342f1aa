"""Traces and models for the tests of tuning."""

import math
from dataclasses import replace

import numpy as np
import pytest
from kernel_models import filter_model, order_block

from hdbench.filter import Channels, SlowBlock
from hdbench.filter.kalman import kernel_form


def compiled_kernel():
    try:
        return kernel_form("c") is not None
    except ValueError:
        return False


def needs_compiled_kernel():
    """Skip where the likelihood would run in Python: a hundred times slower."""
    if not compiled_kernel():
        pytest.skip("the C kernel was not compiled here")


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


def recorded(*length, **options):
    """Return what `turning` gives as channels."""
    t, v, angle, y = turning(*length, **options)
    return channels(t, v, y, angle)


def tuned_like():
    """Return a model as a tuning makes them."""
    output = order_block(0.01, 1e-7, "misalignment")
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


GUARDED = replace(tuned_like(), torque_limit_nm=20.0, stuck_samples=5)
