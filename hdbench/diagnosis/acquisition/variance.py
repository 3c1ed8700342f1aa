"""Noise that grows with the speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from hdbench.diagnosis.acquisition.channels import robust_std
from hdbench.records.trace import FloatArray

__all__ = ["SpeedNoise", "find_speed_noise", "speed_variance", "variance_score"]

# blocks in time: noise that changes with time alone must not be taken for a law of the speed
_BLOCKS = 24
# Fisher scoring converges within ten rounds
_ROUNDS = 50
# squares above this many times the median are outliers, no variance: 2e-7 of normal samples
_OUTLIER = 60.0
_LEAST_SAMPLES = 500
# share of the record's range of squared speeds that a half has to show to have a say
_VARIED = 0.2


@dataclass(frozen=True, slots=True)
class SpeedNoise:
    """Variance ``s0^2 + s1^2 w^2`` of white noise in units of its mean.

    Parameters
    ----------
    still : float
        s0^2, of the mean variance.
    slope, slope_std : float
        s1^2, of the mean variance per (rad/s)^2, and its standard uncertainty.
    sigmas : float
        Score statistic of the slope.
    nats : float
        Log likelihood ratio.
    """

    still: float
    slope: float
    slope_std: float
    sigmas: float
    nats: float


def speed_variance(law: SpeedNoise, velocity_rad_s: FloatArray) -> FloatArray:
    """Return the variance over its mean.

    Parameters
    ----------
    law : SpeedNoise
        Law.
    velocity_rad_s : ndarray, shape (n,)
        Velocity, rad/s.

    Returns
    -------
    ndarray, shape (n,)
    """
    return np.asarray(law.still + law.slope * velocity_rad_s**2)


def variance_score(squares: FloatArray, regressor: FloatArray) -> float:
    """Return the score of a slope of the variance, with the spread of the squares as it is.

    Parameters
    ----------
    squares : ndarray, shape (n,)
        Squared residuals.
    regressor : ndarray, shape (n,)
        What the variance may follow.

    Returns
    -------
    float
        Standard deviations; normal without a slope.
    """
    centred = regressor - regressor.mean()
    spread = float(np.sqrt(np.mean((squares - squares.mean()) ** 2 * centred**2) * len(squares)))
    return float((squares - squares.mean()) @ centred) / spread if spread > 0.0 else 0.0


def _likelihood(squares: FloatArray, variance: FloatArray) -> float:
    return -0.5 * float(np.sum(np.log(variance) + squares / variance))


def find_speed_noise(
    white: FloatArray, used: NDArray[np.bool_], velocity_rad_s: FloatArray, level: float
) -> SpeedNoise | None:
    """Return the law of noise that grows with the speed.

    Parameters
    ----------
    white : ndarray, shape (n,)
        Whitened residual of the extended model.
    used : ndarray of bool, shape (n,)
        Its samples.
    velocity_rad_s : ndarray, shape (n,)
        Motor velocity, rad/s.
    level : float
        Probability of a law without any effect, in (0, 1).

    Returns
    -------
    SpeedNoise or None
        None where the variance does not grow with the square of the speed as surely as that, where
        that growth is not seen in both halves of the record, or where a variance that changes with
        time alone is likelier.

    Notes
    -----
    The slope is that of greatest likelihood for normal noise, by Fisher scoring.
    """
    good = used & np.isfinite(velocity_rad_s)
    if int(good.sum()) < _LEAST_SAMPLES:
        return None
    squares, speed = white[good] ** 2, velocity_rad_s[good] ** 2
    kept = squares < _OUTLIER * max(float(np.median(squares)), 1e-12)
    squares, speed = squares[kept], speed[kept]
    mean = float(squares.mean())
    if not mean > 0.0 or not robust_std(speed) + float(np.ptp(speed)) > 0.0:
        return None
    squares = squares / mean
    sigmas = variance_score(squares, speed)
    if not sigmas > -ndtri(level) or not _in_both_halves(squares, speed):
        return None
    still, slope, std = _fitted(squares, speed)
    law = SpeedNoise(still, slope, std, sigmas, 0.0)
    gain = _likelihood(squares, still + slope * speed) - _likelihood(squares, np.ones(len(squares)))
    if gain < _over_time(squares):
        return None
    return SpeedNoise(law.still, law.slope, law.slope_std, sigmas, gain)


def _in_both_halves(squares: FloatArray, speed: FloatArray) -> bool:
    """Return whether the variance grows in each half of the record that shows several speeds."""
    half = len(squares) // 2
    for part in (slice(0, half), slice(half, None)):
        varied = float(np.ptp(speed[part])) > _VARIED * float(np.ptp(speed))
        if varied and not variance_score(squares[part], speed[part]) > 0.0:
            return False
    return True


def _fitted(squares: FloatArray, speed: FloatArray) -> tuple[float, float, float]:
    """Return s0^2, s1^2 and the standard uncertainty of s1^2, by greatest likelihood."""
    scale = float(speed.max())
    design = np.column_stack([np.ones(len(speed)), speed / scale])
    values = np.array([0.5, 0.5])
    for _ in range(_ROUNDS):
        variance = design @ values
        weights = 0.5 / variance**2
        fisher = (design * weights[:, None]).T @ design
        step = np.linalg.solve(fisher, (design * weights[:, None]).T @ squares)
        # a variance stays positive: a thousandth of the mean is none
        moved = np.maximum(step, 1e-3)
        done = float(np.abs(moved - values).max()) < 1e-9
        values = moved
        if done:
            break
    covariance = np.linalg.inv(fisher)
    return float(values[0]), float(values[1]) / scale, float(np.sqrt(covariance[1, 1])) / scale


def _over_time(squares: FloatArray) -> float:
    """Return the log likelihood that a variance for each of 24 blocks of time gains, paid for."""
    means = [max(float(part.mean()), 1e-12) for part in np.array_split(squares, _BLOCKS)]
    counts = [len(part) for part in np.array_split(squares, _BLOCKS)]
    gain = -0.5 * sum(n * np.log(m) for n, m in zip(counts, means, strict=True))
    return float(gain - 0.5 * (_BLOCKS - 1) * np.log(len(squares)))
