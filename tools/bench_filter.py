"""Print what one sample of the filter costs: C kernel, NumPy form, dense textbook loop.

Usage: python tools/bench_filter.py [--samples N]

All forms are timed in one run on one trace, because a shared machine allows ratios only.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from hdbench.filter import FilterModel, OnlineFilter, OscillatorBlock
from hdbench.filter.core import run_form
from hdbench.records import FloatArray

_ROUNDS = 5
_SLOW_SAMPLES = 5_000
_PERIOD_S = 1e-3


def model_of(orders: tuple[float, ...]) -> FilterModel:
    """Return a model with blocks at `orders` and the noise of the report.

    Parameters
    ----------
    orders : tuple of float
        Cycles per motor turn.

    Returns
    -------
    FilterModel
        The model.
    """
    blocks = tuple(OscillatorBlock(order, "ripple", 1000.0) for order in orders)
    return FilterModel("bench", blocks, 1.0, 1.725e-2, 100.0, 0.005, False, {})


def trace(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return time, velocity with reversals, and torque with ripple and noise, n samples."""
    rng = np.random.default_rng(1)
    time_s = np.arange(n) * _PERIOD_S
    velocity = 156.0 * np.sin(2.0 * np.pi * 0.3 * time_s)
    angle = np.cumsum(velocity) * _PERIOD_S
    torque = 0.4 * np.cos(2.0 * angle) + 0.2 * np.cos(4.0 * angle) + rng.normal(0.0, 0.05, n)
    return time_s, velocity, torque


def dense_loop(model: FilterModel, time_s: FloatArray, v: FloatArray, y: FloatArray) -> None:
    """Run equations 8-10 with full matrices, expected torque left out."""
    n = 2 * len(model.blocks)
    c = np.zeros((1, n))
    c[0, ::2] = 1.0
    noise = np.diag(np.repeat([block.process_noise for block in model.blocks], 2))
    p, x, phi = np.eye(n), np.zeros((n, 1)), np.zeros((n, n))
    for k in range(time_s.size - 1):
        turn = v[k] * (time_s[k + 1] - time_s[k])
        for i, block in enumerate(model.blocks):
            cosine, sine = np.cos(block.order * turn), np.sin(block.order * turn)
            phi[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = ((cosine, sine), (-sine, cosine))
        gain = phi @ p @ c.T / (model.measurement_noise + c @ p @ c.T)
        x = phi @ x + gain @ (y[k] - c @ x)
        p = noise + (phi - gain @ c) @ p @ phi.T


def best_ns(work: Callable[[], object], n: int) -> float:
    """Return the least time of some rounds, ns per sample."""
    times = []
    for _ in range(_ROUNDS):
        start = time.perf_counter_ns()
        work()
        times.append(time.perf_counter_ns() - start)
    return min(times) / n


def main() -> None:
    """Time every form on models of 4, 6, 8 and 12 states."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--samples", type=int, default=1_000_000, help="samples for the C kernel")
    samples = max(parser.parse_args().samples, 1)
    few = min(samples, _SLOW_SAMPLES)
    long, short = trace(samples), trace(few)
    try:
        run_form("c")
        compiled = True
    except ValueError as error:
        print(error)
        compiled = False
    print(
        f"{'states':>6} {'C ns':>9} {'NumPy ns':>10} {'dense ns':>10} {'NumPy/C':>8} {'dense/C':>8}"
    )
    for orders in ((2.0, 4.0), (2.0, 4.0, 0.01), (1.0, 2.0, 4.0, 0.01), (1, 2, 3, 4, 5, 0.01)):
        model = model_of(tuple(float(order) for order in orders))

        def run(form: str, data: tuple[FloatArray, ...], model: FilterModel = model) -> object:
            return OnlineFilter(model, kernel=form).process(*data)

        fast = best_ns(lambda run=run: run("c", long), samples) if compiled else float("nan")
        numpy_form = best_ns(lambda run=run: run("numpy", short), few)
        dense = best_ns(lambda model=model: dense_loop(model, *short), few)
        print(
            f"{2 * len(orders):6d} {fast:9.1f} {numpy_form:10.0f} {dense:10.0f} "
            f"{numpy_form / fast:8.0f} {dense / fast:8.0f}"
        )


if __name__ == "__main__":
    main()
