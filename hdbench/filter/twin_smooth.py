"""The smoother and the batch in Python: what runs where the C kernel was not compiled."""

from __future__ import annotations

import math

import numpy as np

from hdbench.filter.layout import USABLE
from hdbench.filter.twin import run, unused_state
from hdbench.filter.twin_motion import first_bad_time, observe
from hdbench.filter.twin_recursion import Recursion
from hdbench.records import FloatArray

__all__ = ["batch", "smooth"]

Samples = tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]


def batch(
    model: FloatArray,
    samples: Samples,
    outputs: tuple[FloatArray | None, ...],
    sums: FloatArray,
    /,
) -> int:
    """Filter many traces of one model; the C kernel's signature and its numbers."""
    time, velocity, torque, angle = samples
    n = time.size
    for j in range(torque.shape[1]):
        found = [np.empty(n) for _ in range(7)]
        own = (time, velocity[:, j], torque[:, j], None if angle is None else angle[:, j])
        total = np.empty(3)
        bad = run(model, unused_state(model), own, tuple(found), np.empty(n, np.uint8), total)
        if bad >= 0:
            return bad
        for out, column in zip(outputs, (4, 5, 6), strict=True):
            if out is not None:
                out[:, j] = found[column]
        sums[:, j] = total
    return -1


def smooth(
    model: FloatArray,
    samples: Samples,
    expected: FloatArray,
    mean: FloatArray,
    covariance: FloatArray | None,
    /,
) -> int:
    """Smooth a trace; the C kernel's signature and, to rounding, its numbers."""
    time, velocity, torque, angle = samples
    state = unused_state(model)
    bad = first_bad_time(state, time)
    if bad >= 0:
        return bad
    filtering = Recursion(model, state)
    turn, dt = observe(state, model, (time, velocity, angle), expected)
    usable = (np.abs(torque) <= USABLE) & (np.abs(velocity) <= USABLE)
    residual = np.where(usable, torque - expected, math.nan)
    steps = filtering.transitions(turn, dt)
    first, records = _forward(filtering, steps, residual.tolist())
    mean[:first] = math.nan
    if covariance is not None:
        covariance[:first] = math.nan
        covariance = covariance[first:]
    _backward(filtering, records, steps[first:], mean[first:], covariance)
    return -1


Record = tuple[FloatArray, FloatArray, float, float]
Steps = list[list[list[float]]]


def _forward(filtering: Recursion, steps: Steps, residual: list[float]) -> tuple[int, list[Record]]:
    """Return the first sample of the filter, and predicted z and P, innovation and S of each."""
    n = filtering.n
    first, records = len(residual), []
    for k, (step, value) in enumerate(zip(steps, residual, strict=True)):
        used = filtering.likelihood.used
        found = filtering.step(step, value)
        if not filtering.started:
            continue
        first = min(first, k)
        z, p = filtering.z, filtering.p
        dense = np.zeros((2 * n, 2 * n))
        for i, row in enumerate(p):
            dense[i, : i + 1] = dense[: i + 1, i] = row
        innovation = found[3] if filtering.likelihood.used > used else math.nan
        records.append((np.array(z), dense, innovation, found[4]))
    return first, records


def _backward(
    filtering: Recursion,
    records: list[Record],
    steps: Steps,
    mean: FloatArray,
    covariance: FloatArray | None,
) -> None:
    n, n_oscillators = filtering.n, filtering.blocks.n_oscillators
    vector, matrix = np.zeros(2 * n), np.zeros((2 * n, 2 * n))
    for k in range(len(records) - 1, -1, -1):
        z, p, innovation, variance = records[k]
        c, f, axes = np.zeros(2 * n), np.eye(2 * n), np.eye(2 * n)
        for i, step in enumerate(steps[k]):
            at = slice(2 * i, 2 * i + 2)
            if i < n_oscillators:
                c[at] = step[:2]
                axes[at, at] = ((step[0], step[1]), (-step[1], step[0]))
            else:
                c[2 * i] = 1.0
                f[at, at] = np.reshape(step[:4], (2, 2))
        if not math.isnan(innovation):
            gain = p @ c / variance
            pull = matrix @ gain
            vector = vector + c * (innovation / variance - gain @ vector)
            matrix = matrix - np.outer(c, pull) - np.outer(pull, c)
            matrix += np.outer(c, c) * (gain @ pull + 1.0 / variance)
        mean[k] = (axes @ (z + p @ vector)).reshape(-1, 2)
        if covariance is not None:
            smoothed = axes @ (p - p @ matrix @ p) @ axes.T
            for i in range(n):
                a = 2 * i
                covariance[k, i] = smoothed[a, a], smoothed[a, a + 1], smoothed[a + 1, a + 1]
        vector = f.T @ vector
        matrix = f.T @ matrix @ f
