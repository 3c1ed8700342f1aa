"""Standard errors, and limits where the likelihood has no peak."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from hdbench.filter.channels import Channels
from hdbench.filter.tuning.likelihood import score
from hdbench.filter.tuning.parameters import Parameter, Problem
from hdbench.filter.tuning.result import Estimate
from hdbench.filter.tuning.search import curvature
from hdbench.records import FloatArray

__all__ = ["estimate_all"]

_DROP_NATS = 2.0  # as far as two standard errors of a normal likelihood
_FLAT_NATS = 0.25  # information below which one standard error is more than a factor e^2
_BISECTIONS = 6


def estimate_all(
    problem: Problem, logs: FloatArray, records: Sequence[Channels]
) -> tuple[Estimate, ...]:
    """Return every tuned number with its standard error.

    Notes
    -----
    The standard error of a logarithm is the root of the inverse observed information over the
    parameters that the data inform about; the others have no peak and get limits instead.
    """

    def value(at: FloatArray) -> float:
        return score(problem.model(at), records).log_likelihood

    best = score(problem.model(logs), records)
    information = curvature(_inside(problem, logs), value)
    peaked = np.flatnonzero(np.diag(information) > _FLAT_NATS)
    errors: dict[int, float] = {}
    if peaked.size:
        covariance = np.linalg.pinv(information[np.ix_(peaked, peaked)], hermitian=True)
        for place, variance in zip(peaked.tolist(), np.diag(covariance).tolist(), strict=True):
            if variance > 0.0:
                errors[place] = math.sqrt(variance)
    # chi-square of the concentrated variance: its logarithm has variance 2 / n
    noise = Estimate("measurement_noise", "(N m)^2", best.noise_nm2, math.sqrt(2.0 / best.samples))
    found = [noise]
    for i, parameter in enumerate(problem.parameters):
        scale = best.noise_nm2 if parameter.relative else 1.0
        below, above = (None, None) if i in errors else _limits(i, parameter, logs, value)
        found.append(
            Estimate(
                parameter.name,
                parameter.unit,
                math.exp(logs[i]) * scale,
                errors.get(i),
                below=None if below is None else math.exp(below) * scale,
                above=None if above is None else math.exp(above) * scale,
            )
        )
    return tuple(found)


def _inside(problem: Problem, logs: FloatArray) -> FloatArray:
    """Return the point a step away from its bounds, where differences can be taken."""
    lower = np.array([p.lower for p in problem.parameters]) + 0.1
    upper = np.array([p.upper for p in problem.parameters]) - 0.1
    return np.asarray(np.clip(logs, lower, upper), dtype=np.float64)


def _limits(
    index: int, parameter: Parameter, logs: FloatArray, value: Callable[[FloatArray], float]
) -> tuple[float | None, float | None]:
    """Return upper and lower logarithm beyond which the likelihood falls by two nats."""
    here = value(logs)

    def falls(log: float) -> bool:
        moved = logs.copy()
        moved[index] = log
        return value(moved) < here - _DROP_NATS

    found: list[float | None] = []
    for far in (parameter.upper, parameter.lower):
        near = float(logs[index])
        if not falls(far):
            found.append(None)
            continue
        for _ in range(_BISECTIONS):
            middle = 0.5 * (near + far)
            near, far = (near, middle) if falls(middle) else (middle, far)
        found.append(far)
    return found[0], found[1]
