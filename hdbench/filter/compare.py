"""What the filter is held against: a plain low-pass, and its own transfer function."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdbench.errors import DataError
from hdbench.filter.model import FilterModel
from hdbench.filter.steady import steady_filter
from hdbench.records import FloatArray

__all__ = ["butterworth_lowpass", "transfer_at_steady_speed"]


def butterworth_lowpass(
    torque_nm: ArrayLike, *, sample_period_s: float, cutoff_hz: float, order: int
) -> FloatArray:
    """Low-pass the torque causally, the report's comparison for its filter.

    Parameters
    ----------
    torque_nm : array_like, shape (n,)
        Torque, N m. From a NaN on, no output is known: those samples stay NaN.
    sample_period_s : float
        Sampling period, s, > 0, taken as uniform.
    cutoff_hz : float
        -3 dB frequency, Hz, in (0, half the sampling frequency).
    order : int
        Order of the low-pass, 1 to 8.

    Returns
    -------
    ndarray, shape (n,)
        Low-passed torque, N m, started in the steady state of the first sample.

    Raises
    ------
    DataError
        If the period, cut-off or order is out of its domain.

    Notes
    -----
    Second-order sections of the bilinear Butterworth design, run forward only, so its delay is
    the one a control loop would see.

    References
    ----------
    .. [1] S. Butterworth, "On the theory of filter amplifiers", Wireless Engineer 7 (1930).
    """
    if not 0.0 < sample_period_s < math.inf or not 0.0 < cutoff_hz < 0.5 / sample_period_s:
        raise DataError(
            f"cut-off {cutoff_hz!r} Hz at a sampling period of {sample_period_s!r} s; needed: "
            "above 0 and below half the sampling frequency",
            where="filter.butterworth_cutoff_hz",
            fix="lower the cut-off",
        )
    if not 1 <= order <= 8:
        raise DataError(
            f"order {order!r}; needed: 1 to 8",
            where="filter.butterworth_order",
            fix="choose a low-pass order from 1 to 8",
        )
    from scipy.signal import butter, sosfilt, sosfilt_zi

    torque = np.asarray(torque_nm, dtype=np.float64)
    if torque.size == 0:
        return torque.copy()
    sections = butter(order, cutoff_hz, fs=1.0 / sample_period_s, output="sos")
    filtered, _ = sosfilt(sections, torque, zi=sosfilt_zi(sections) * torque[0])
    return np.asarray(filtered, dtype=np.float64)


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
