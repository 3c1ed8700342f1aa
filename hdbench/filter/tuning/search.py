"""Search of the most likely point, and standard errors by the curvature there."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from hdbench.filter.online import Channels
from hdbench.filter.tuning.problem import LogLikelihood, Parameter, Problem, score
from hdbench.filter.tuning.result import Estimate, Optimum, Start
from hdbench.records import FloatArray

_STEP = 1e-4  # of a logarithm: the likelihood's own rounding, 1e-8 nats, then moves a slope by 1e-4
_SHARPNESS_STEP = 2e-3  # the same rounding then moves a second derivative by 0.01
_STRETCHES = 4  # of the climb; each measures the logarithms anew
_FIRST_ITERATIONS = 12
_LEAST_GAIN = 1e-11  # relative: 1e-6 nats of 1e5
_LEAST_SLOPE = 0.03  # nats per standard error: 5e-4 nats from the top
_SETTLED_NATS = 0.02  # a start that ends within this of the best has found the same point

_DROP_NATS = 2.0  # as far as two standard errors of a normal likelihood
_FLAT_NATS = 0.25  # information below which one standard error is more than a factor e^2
_BISECTIONS = 6


def maximise(
    problem: Problem, value: LogLikelihood, *, preview: LogLikelihood, max_evaluations: int
) -> Optimum:
    """Search the most likely point by L-BFGS-B from every start.

    Notes
    -----
    The slope is a forward difference of 1e-4 in the logarithm. After a first stretch every
    logarithm is measured in its own standard error, as the curvature there gives it: the frequency
    of a sharp resonance is known a thousand times better than its variance.

    References
    ----------
    .. [1] R. H. Byrd, P. Lu, J. Nocedal, C. Zhu, "A limited memory algorithm for bound constrained
       optimization", SIAM J. Sci. Comput. 16 (1995) 1190-1208.
    """
    ends = [
        _climb(np.array(start), problem.bounds, (preview, value), max_evaluations)
        for start in problem.starts()
    ]
    best_logs, best = max(ends, key=lambda end: end[1].log_likelihood)
    agreed = sum(end.log_likelihood > best.log_likelihood - _SETTLED_NATS for _, end in ends)
    return Optimum(best_logs, best.log_likelihood, tuple(end for _, end in ends), agreed)


def _climb(
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    values: tuple[LogLikelihood, LogLikelihood],
    most: int,
) -> tuple[FloatArray, Start]:
    """Climb from one start: a first stretch on a part of the data, then by standard errors."""
    from scipy.optimize import minimize

    logs, count = start, _Counted(values[0], bounds)
    scale = np.ones(logs.size)
    converged, reached, slope = False, -np.inf, np.inf
    for stretch in range(_STRETCHES):
        left = (most - count.evaluations) // (logs.size + 1)
        if converged or left < 1:
            break
        found = minimize(
            count.scaled(scale),
            logs / scale,
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(bounds[0] / scale, bounds[1] / scale, strict=True)),
            options={
                "maxfun": left,
                "maxiter": _FIRST_ITERATIONS if stretch == 0 else 15000,
                "ftol": _LEAST_GAIN,
                "gtol": _LEAST_SLOPE,
            },
        )
        logs = np.clip(np.asarray(found.x) * scale, *bounds)
        reached, slope = -float(found.fun), count.free_slope(found.x, found.jac, scale)
        count.value = values[1]
        if stretch == 0 and not values[1](logs) > values[1](start):
            logs = start  # the part had nothing of what the whole has, such as a step of the load
        converged = stretch > 0 and bool(found.success) and slope < 10.0 * _LEAST_SLOPE
        if not converged:
            scale = 1.0 / np.sqrt(np.maximum(count.sharpness(logs), 1.0))
    return logs, Start(reached, count.evaluations, converged, slope)


class _Counted:
    """Minus the log-likelihood with its slope, counting evaluations."""

    def __init__(self, value: LogLikelihood, bounds: tuple[FloatArray, FloatArray]) -> None:
        self.value, self.bounds, self.evaluations = value, bounds, 0

    def scaled(self, scale: FloatArray) -> Callable[[FloatArray], tuple[float, FloatArray]]:
        """Return what the minimiser calls, in units of `scale`."""

        def fall(units: FloatArray) -> tuple[float, FloatArray]:
            logs = np.clip(units * scale, *self.bounds)
            here = self.value(logs)
            slope = np.empty(logs.size)
            for i in range(logs.size):
                step = _STEP * scale[i]
                step = step if logs[i] + step <= self.bounds[1][i] else -step
                moved = logs.copy()
                moved[i] += step
                slope[i] = (self.value(moved) - here) / step
            self.evaluations += 1 + logs.size
            return -here, -slope * scale

        return fall

    def free_slope(self, units: FloatArray, slope: FloatArray, scale: FloatArray) -> float:
        """Return the largest slope that no bound holds, nats per unit of `scale`."""
        logs = units * scale
        # a bound reached through the scaling is met to rounding
        low = (logs <= self.bounds[0] + 1e-9) & (slope > 0)
        high = (logs >= self.bounds[1] - 1e-9) & (slope < 0)
        return float(np.max(np.abs(np.where(low | high, 0.0, slope)), initial=0.0))

    def sharpness(self, logs: FloatArray) -> FloatArray:
        """Return minus the second derivative along each logarithm; where it is none, 0."""
        self.evaluations += 1 + 2 * logs.size
        inside = np.clip(logs, self.bounds[0] + _SHARPNESS_STEP, self.bounds[1] - _SHARPNESS_STEP)
        return sharpness(inside, self.value)


def sharpness(logs: FloatArray, value: LogLikelihood) -> FloatArray:
    """Return minus the second derivative of the log-likelihood along each logarithm."""
    here, found = value(logs), np.empty(logs.size)
    for i in range(logs.size):
        up, down = logs.copy(), logs.copy()
        up[i] += _SHARPNESS_STEP
        down[i] -= _SHARPNESS_STEP
        found[i] = -(value(up) - 2.0 * here + value(down)) / _SHARPNESS_STEP**2
    return np.where(np.isfinite(found), np.maximum(found, 0.0), 0.0)


def curvature(logs: FloatArray, value: LogLikelihood) -> FloatArray:
    """Return minus the matrix of second derivatives of the log-likelihood."""
    p = logs.size
    steps = np.minimum(0.3 / np.sqrt(np.maximum(sharpness(logs, value), 1e-12)), 0.1)
    here, information = value(logs), np.empty((p, p))

    def at(changes: list[tuple[int, float]]) -> float:
        moved = logs.copy()
        for place, sign in changes:
            moved[place] += sign * steps[place]
        return value(moved)

    for i in range(p):
        second = at([(i, 1.0)]) - 2.0 * here + at([(i, -1.0)])
        information[i, i] = -second / steps[i] ** 2
        for j in range(i):
            cross = sum(a * b * at([(i, a), (j, b)]) for a in (1.0, -1.0) for b in (1.0, -1.0))
            information[i, j] = information[j, i] = -cross / (4.0 * steps[i] * steps[j])
    return information


def estimate_all(
    problem: Problem, logs: FloatArray, records: Sequence[Channels]
) -> tuple[Estimate, ...]:
    """Return every tuned number with its standard error.

    Notes
    -----
    The standard error of a logarithm is the root of the inverse observed information over the
    parameters that the data inform about; the others have no peak and get limits instead.
    """
    best, value = score(problem.model(logs), records), problem.likelihood(records)
    lower, upper = problem.bounds
    # a step away from the bounds, where differences can be taken
    inside = np.asarray(np.clip(logs, lower + 0.1, upper - 0.1), dtype=np.float64)
    information = curvature(inside, value)
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


def _limits(
    index: int, parameter: Parameter, logs: FloatArray, value: LogLikelihood
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
