"""Samples that are left out, where a noise remembers: bridged alike in data and columns."""

from __future__ import annotations

import numpy as np
import pytest

from hdbench.diagnosis.noise.gaps import bridges
from hdbench.diagnosis.noise.slownoise import RANDOM_WALK, SlowNoise, slow_kernel
from hdbench.diagnosis.noise.whitened import Whitener

N = 4000
GAPS = ((0, 7), (500, 540), (541, 600), (2000, 2400), (3990, 4000))


def valid() -> np.ndarray:
    kept = np.ones(N, dtype=bool)
    for begin, end in GAPS:
        kept[begin:end] = False
    return kept


def long_whitener() -> Whitener:
    kept = valid()
    return Whitener(slow_kernel(SlowNoise(1e4, RANDOM_WALK, 0.0), N), 0.3, kept, kept)


def test_bridges_are_straight_lines_between_the_nearest_samples() -> None:
    kept = valid()
    across = bridges(kept, 1.0)
    assert across is not None
    time = np.arange(N, dtype=float)
    values = np.where(kept, 3.0 + 0.5 * time, 1e6)[:, None]
    whole = across.cross(values)[:, 0]
    inside = slice(7, 3990)
    np.testing.assert_allclose(whole[inside], 3.0 + 0.5 * time[inside], rtol=1e-13)
    # beyond the ends of the record the nearest sample stands
    np.testing.assert_allclose(whole[:7], 3.0 + 0.5 * 7, rtol=1e-13)
    np.testing.assert_allclose(whole[3990:], 3.0 + 0.5 * 3989, rtol=1e-13)


def test_nothing_left_out_needs_no_bridge() -> None:
    assert bridges(np.ones(9, dtype=bool), 3.0) is None
    assert bridges(np.zeros(9, dtype=bool), 3.0) is None


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_the_adjoint_of_a_long_whitener_is_its_transpose(dtype: type) -> None:
    rng = np.random.default_rng(1)
    whitener = long_whitener()
    columns = rng.standard_normal((N, 3)).astype(dtype)
    others = rng.standard_normal((N, 2)).astype(dtype)
    forward = others.T.astype(float) @ np.asarray(whitener.apply(columns), dtype=float)
    backward = np.asarray(whitener.adjoint(others), dtype=float).T @ columns.astype(float)
    # rounding of sums over 4000 products
    np.testing.assert_allclose(forward, backward, atol=N * np.finfo(dtype).eps)


def test_what_is_left_out_does_not_matter() -> None:
    whitener = long_whitener()
    values = np.random.default_rng(2).standard_normal(N)
    spoilt = np.where(valid(), values, 1e9)
    np.testing.assert_array_equal(whitener.apply(values), whitener.apply(spoilt))


def test_a_walk_with_gaps_is_as_white_as_one_without() -> None:
    rng = np.random.default_rng(3)
    power, n = 1e5, 20_000
    step = np.sqrt(power) * np.pi / n  # spectrum of 1 + power k^-2 over half cycles k
    walk = 50.0 + np.cumsum(step * rng.standard_normal(n)) + rng.standard_normal(n)
    kept = np.ones(n, dtype=bool)
    for begin in range(300, n, 400):
        kept[begin : begin + 40] = False
    kernel = slow_kernel(SlowNoise(power, RANDOM_WALK, 0.0), n)
    some = Whitener(kernel, 1.0, kept, kept)
    left = np.asarray(some.apply(walk - walk[0]))[kept]
    # one tenth of the samples is left out: their neighbours hold a little more
    assert np.var(left) == pytest.approx(1.0, abs=0.1)
    assert np.abs(np.mean(left)) < 5.0 / np.sqrt(len(left))
