"""What run, batch and smooth answer."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.records import FloatArray

__all__ = ["BatchResult", "RunResult", "SmoothResult"]


@dataclass(frozen=True, slots=True)
class RunResult:
    """What one run says about each sample; arrays of shape (n,), N m unless said otherwise.

    Parameters
    ----------
    torque_expected_nm : ndarray
        J * acceleration / N by the online differentiator.
    ripple_nm, misalignment_nm, slow_nm : ndarray
        Predicted sum of the blocks of each part, from earlier samples only.
    torque_filtered_nm : ndarray
        Torque minus ripple and misalignment (the slow part stays in); NaN where torque is missing.
    innovation_nm : ndarray
        Torque minus expected torque minus all predictions; NaN where the sample is missing.
    innovation_variance_nm2 : ndarray
        S = R + C P C', (N m)^2; NaN before the filter has started.
    flags : ndarray of uint8
        Bits `hdbench.filter.layout.MISSING` (torque or velocity is), ``GATED`` (outlier, only
        predicted), ``UNRESOLVED`` (an oscillator's variance is beyond 200 S: what it holds is not
        known from the data, as at standstill).
    n_used : int
        Samples that were used as measurements.
    sum_log_variance, sum_normalised_squares : float
        Sum of log S and of e^2 / S over these samples; with R and all Q scaled by one factor, that
        factor's best value is ``sum_normalised_squares / n_used``.
    """

    torque_expected_nm: FloatArray
    ripple_nm: FloatArray
    misalignment_nm: FloatArray
    slow_nm: FloatArray
    torque_filtered_nm: FloatArray
    innovation_nm: FloatArray
    innovation_variance_nm2: FloatArray
    flags: NDArray[np.uint8]
    n_used: int
    sum_log_variance: float
    sum_normalised_squares: float

    @property
    def log_likelihood(self) -> float:
        """Gaussian log-likelihood of the samples used, nats."""
        return -0.5 * (
            self.n_used * math.log(2.0 * math.pi)
            + self.sum_log_variance
            + self.sum_normalised_squares
        )


@dataclass(frozen=True, slots=True)
class BatchResult:
    """What a batch says: one column per trace.

    Parameters
    ----------
    torque_filtered_nm : ndarray, shape (n, n_traces), or None
        As in `RunResult`.
    innovation_nm, innovation_variance_nm2 : ndarray, shape (n, n_traces), or None
        As in `RunResult`.
    n_used, sum_log_variance, sum_normalised_squares : ndarray, shape (n_traces,)
        As in `RunResult`.
    """

    torque_filtered_nm: FloatArray | None
    innovation_nm: FloatArray | None
    innovation_variance_nm2: FloatArray | None
    n_used: FloatArray
    sum_log_variance: FloatArray
    sum_normalised_squares: FloatArray

    @property
    def log_likelihood(self) -> FloatArray:
        """Gaussian log-likelihood of each trace, nats."""
        return -0.5 * (
            self.n_used * math.log(2.0 * math.pi)
            + self.sum_log_variance
            + self.sum_normalised_squares
        )


@dataclass(frozen=True, slots=True)
class SmoothResult:
    """Blocks from all samples, before and after each one.

    Parameters
    ----------
    mean : ndarray, shape (n, n_blocks, 2)
        Smoothed states in the blocks' given order, N m: an oscillator's torque ``A cos(psi)`` and
        ``-A sin(psi)``; a slow torque and its slope (0 for kinds of one state).
    covariance : ndarray, shape (n, n_blocks, 3), or None
        (p11, p12, p22) of each block, (N m)^2.
    torque_expected_nm : ndarray, shape (n,)
        As in `RunResult`.
    """

    mean: FloatArray
    covariance: FloatArray | None
    torque_expected_nm: FloatArray
