"""The filter at constant speed: its steady covariance and gain, without a solver's tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdbench.errors import DataError
from hdbench.filter.kalman import pack
from hdbench.filter.model import FilterModel
from hdbench.filter.transitions import transitions
from hdbench.records import FloatArray

_DOUBLINGS = 60  # 2^60 samples: what has not converged then never will
_SETTLED = 1e-13  # relative change of P in one doubling: rounding


@dataclass(frozen=True, slots=True)
class SteadyFilter:
    r"""The filter at one speed after all time, as a linear system.

    Notes
    -----
    With measured torque y: :math:`x(k+1) = A x(k) + B y(k)`, filtered torque
    :math:`y(k) - c\,x(k)`, c = `taken`.
    """

    closed: FloatArray  # A = F (I - K C)
    gain: FloatArray  # B = F K
    taken: FloatArray  # 1 at the first state of every block that is taken off the torque
    covariance: FloatArray  # of the predicted states
    sample_period_s: float

    def transfer(self, frequency_hz: FloatArray) -> NDArray[np.complex128]:
        """Return filtered over measured torque."""
        n = self.gain.size
        z = np.exp(2j * np.pi * frequency_hz * self.sample_period_s)
        inner = z[:, None, None] * np.eye(n) - self.closed
        right = np.broadcast_to(self.gain[:, None], (z.size, n, 1)).astype(np.complex128)
        return np.asarray(1.0 - (np.linalg.solve(inner, right)[:, :, 0] @ self.taken))

    def noise_gain(self) -> float:
        """Return the standard deviation of filtered over that of white measured noise."""
        spread = _geometric_sum(self.closed, self.gain[:, None] * self.gain)
        return math.sqrt(1.0 + float(self.taken @ spread @ self.taken))

    def slowest_mode_s(self) -> float:
        """Return the time constant of the mode that forgets last, s; infinite where none does."""
        largest = float(np.max(np.abs(np.linalg.eigvals(self.closed))))
        if not largest < 1.0:
            return math.inf
        return -self.sample_period_s / math.log(largest) if largest > 0.0 else 0.0


def _geometric_sum(a: FloatArray, q: FloatArray) -> FloatArray:
    """Return the sum of A^k Q A'^k over k >= 0, by doubling."""
    total, power = q.copy(), a.copy()
    for _ in range(_DOUBLINGS):
        step = power @ total @ power.T
        total = total + step
        if not np.max(np.abs(step)) > _SETTLED * np.max(np.abs(total)):
            break
        power = power @ power
    return total


def steady_filter(
    model: FilterModel, velocity_rad_s: float, sample_period_s: float
) -> SteadyFilter:
    """Return the filter at a constant speed after all time.

    Notes
    -----
    Structure-preserving doubling of the Riccati equation: the k-th step stands for 2^k samples, so
    that a filter with a memory of days converges as surely as one of milliseconds.

    References
    ----------
    .. [1] B. D. O. Anderson, "Second-order convergent algorithms for the steady-state Riccati
       equation", International Journal of Control 28 (1978) 295-306.
    """
    if not (0.0 < abs(velocity_rad_s) < math.inf and 0.0 < sample_period_s < math.inf):
        reason = f"needed a velocity other than 0, and a period above 0, found {sample_period_s!r}"
        raise _no_steady_gain(velocity_rad_s, reason)
    steps = transitions(pack(model), velocity_rad_s * sample_period_s, sample_period_s)
    n_states = [2] * len(model.blocks) + [block.n_states for block in model.slow]
    # kinds of one state have no second one
    kept = np.array([2 * i + j for i, n in enumerate(n_states) for j in range(n)], dtype=np.intp)
    f, q = _dense(steps, kept)
    c = np.tile((1.0, 0.0), len(n_states))[kept]
    taken = np.where(kept < 2 * len(model.blocks), c, 0.0)
    p = _steady_covariance(f, q, c, model.measurement_noise, velocity_rad_s)
    k = p @ c / (model.measurement_noise + float(c @ p @ c))
    closed = f - np.outer(f @ k, c)
    covariance = np.zeros((2 * len(n_states), 2 * len(n_states)))
    covariance[np.ix_(kept, kept)] = p
    return SteadyFilter(closed, f @ k, taken, covariance, sample_period_s)


def transfer_at_steady_speed(
    model: FilterModel,
    velocity_rad_s: float,
    sample_period_s: float,
    frequency_hz: ArrayLike,
) -> NDArray[np.complex128]:
    r"""Return the steady transfer function from measured to filtered torque.

    Parameters
    ----------
    model : FilterModel
        Orders and noise.
    velocity_rad_s : float
        Constant motor velocity, rad/s, not 0.
    sample_period_s : float
        Sampling period, s, > 0.
    frequency_hz : array_like
        Frequencies, Hz.

    Returns
    -------
    ndarray of complex, shape of `frequency_hz`
        Filtered over measured torque, dimensionless, at expected torque 0.

    Raises
    ------
    DataError
        If no steady gain exists: at standstill, or where two blocks alias to one frequency.

    Notes
    -----
    The steady P solves the Riccati equation of the recursion; with the transition F and
    :math:`K = F P C^T / (R + C P C^T)`, and c that picks the blocks taken off the torque,
    :math:`H(z) = 1 - c (z I - F + K C)^{-1} K`, zero at every block's own frequency.
    """
    steady = steady_filter(model, velocity_rad_s, sample_period_s)
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    response = steady.transfer(frequency.ravel())
    return np.asarray(response.reshape(frequency.shape), dtype=np.complex128)


def _dense(steps: FloatArray, kept: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
    """Return F and Q as dense matrices over the states kept."""
    n = 2 * steps.shape[0]
    f, q = np.zeros((n, n)), np.zeros((n, n))
    for i, step in enumerate(steps):
        at = slice(2 * i, 2 * i + 2)
        f[at, at] = step[:4].reshape(2, 2)
        q[at, at] = [[step[4], step[5]], [step[5], step[6]]]
    return f[np.ix_(kept, kept)], q[np.ix_(kept, kept)]


def _steady_covariance(
    f: FloatArray, q: FloatArray, c: FloatArray, r: float, velocity_rad_s: float
) -> FloatArray:
    """Return P of the Riccati equation P = F (P - P C' C P / S) F' + Q."""
    a, g, h = f.T.copy(), np.outer(c, c) / r, q.copy()
    identity = np.eye(c.size)
    for _ in range(_DOUBLINGS):
        try:
            w = np.linalg.solve(identity + g @ h, np.hstack((a, g)))
        except np.linalg.LinAlgError as error:
            raise _no_steady_gain(velocity_rad_s, str(error)) from error
        wa, wg = w[:, : c.size], w[:, c.size :]
        step = a.T @ h @ wa
        h = h + 0.5 * (step + step.T)
        g = g + a @ wg @ a.T
        g = 0.5 * (g + g.T)
        a = a @ wa
        if not np.isfinite(h).all():
            break
        if np.max(np.abs(step)) <= _SETTLED * np.max(np.abs(h)):
            return h
    raise _no_steady_gain(velocity_rad_s, "two blocks have one frequency")


def _no_steady_gain(velocity_rad_s: float, reason: str) -> DataError:
    return DataError(
        f"the filter has no steady gain at {velocity_rad_s!r} rad/s: {reason}",
        where="velocity_rad_s",
        fix="ask at a velocity at which the blocks have different frequencies",
    )
