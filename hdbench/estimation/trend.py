"""Slow terms under a signal: gravity, drift, friction; chosen by rule."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.estimation.harmonics import harmonic_columns
from hdbench.estimation.regression import fit_noise, ordinary_fit
from hdbench.records.trace import FloatArray

# degrees tried, in this order, until two in a row do not pay
_DEGREES = (1, 2, 3, 4, 6, 8, 12, 16, 20)
_PATIENCE = 2
# noise order allowed while choosing: the choice compares likelihoods, it does not report them
_CHOICE_AR_ORDER = 12
# velocity over the fastest one at which the direction column has turned: width of a reversal
_REVERSAL_SHARE = 0.02


@dataclass(frozen=True, slots=True)
class Trend:
    """Slow terms that a regression carries beside the components it is asked for."""

    degree: int
    direction: bool = False  # an offset that changes its sign with the direction
    output: bool = False  # cosine and sine of the output angle, for a part of a turn


@dataclass(frozen=True, slots=True)
class SlowMotion:
    """Time, velocity and output angle that slow terms depend on, arrays of shape (n,)."""

    time_s: FloatArray
    velocity_rad_s: FloatArray
    output_angle_rad: FloatArray


def trend_columns(trend: Trend, motion: SlowMotion, used: NDArray[np.bool_]) -> FloatArray:
    """Return the columns of slow terms."""
    time = motion.time_s
    first, last = float(time[used][0]), float(time[used][-1])
    scaled = (2.0 * time - first - last) / max(last - first, np.finfo(float).tiny)
    # outside the samples used the polynomials are not needed and would overflow
    columns = [np.polynomial.legendre.legvander(np.clip(scaled, -1.0, 1.0), trend.degree)]
    if trend.direction:
        velocity = motion.velocity_rad_s
        fastest = float(np.max(np.abs(velocity[used])))
        columns.append(np.tanh(velocity / (_REVERSAL_SHARE * fastest))[:, None])
    if trend.output:
        columns.append(harmonic_columns(motion.output_angle_rad, [1.0]))
    return np.hstack(columns)


def choose_trend(
    others: FloatArray,
    response: FloatArray,
    motion: SlowMotion,
    used: NDArray[np.bool_],
    *,
    starts: NDArray[np.bool_] | None = None,
) -> Trend:
    """Choose the slow terms of a regression by BIC.

    Notes
    -----
    ``BIC = n ln(innovation variance) + (AR order + columns) ln n``. Offset by direction (where
    the motor turns both ways) and sinusoid of the output angle (where it spans less than a turn)
    are tried alone and together; then degrees 1, 2, 3, 4, 6, 8, 12, 16, 20 until two in a row do
    not lower the BIC; a twentieth of the samples bounds the degree.
    """
    n = int(used.sum())

    def bic(trend: Trend) -> float:
        columns = trend_columns(trend, motion, used)
        try:
            fit = ordinary_fit(np.hstack([columns, others]), response, used)
            noise = fit_noise(fit.residual, used, starts=starts, max_order=_CHOICE_AR_ORDER)
        except ValueError:
            return float("inf")
        size = columns.shape[1] + others.shape[1] + noise.order
        return float(2.0 * n * np.log(noise.innovation_std) + size * np.log(n))

    moving = motion.velocity_rad_s[used]
    directions = [False]
    if float(np.min(moving)) < 0.0 < float(np.max(moving)):
        directions.append(True)
    outputs = [False]
    if float(np.ptp(motion.output_angle_rad[used])) < 2.0 * np.pi:
        outputs.append(True)
    best = min((Trend(0, d, o) for d in directions for o in outputs), key=bic)
    score, misses = bic(best), 0
    for degree in _DEGREES:
        if degree > n // 20 or misses >= _PATIENCE:
            break
        candidate = replace(best, degree=degree)
        value = bic(candidate)
        misses = 0 if value < score else misses + 1
        if value < score:
            best, score = candidate, value
    return best
