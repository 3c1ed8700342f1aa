"""From sampled angle and velocity to integral and derivative."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.model.localfit import fit_derivative
from hdbench.records.trace import FloatArray

__all__ = [
    "ACCELERATION_WINDOW_S",
    "angle_curvature",
    "integrate_velocity",
    "sampled_acceleration",
    "velocity_slope",
]

# window of the acceleration: 20 ms hold 21 samples at 1 kHz, which leaves J/N times the noise near
# 1 mN m with the profile's tacho, and passes a 10 Hz motion to within 0.1 %
ACCELERATION_WINDOW_S = 0.020
# degrees whose derivative at the centre of the window is exact for cubic velocity
_VELOCITY_DEGREE = 3
_ANGLE_DEGREE = 4
# a step this many median periods long means that samples are missing: one lost sample makes 2
_BRIDGE = 1.5


def integrate_velocity(
    time_s: FloatArray, velocity_rad_s: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Integrate velocity as the contract does.

    Parameters
    ----------
    time_s : ndarray, shape (n_samples,)
        Time, s, strictly increasing.
    velocity_rad_s : ndarray, shape (n_samples,)
        Velocity, rad/s; NaN where lost.

    Returns
    -------
    angle_rad : ndarray, shape (n_samples,)
        angle(0) = 0, angle(k+1) = angle(k) + velocity(k) (t(k+1) - t(k)); a lost velocity is
        replaced by the last one before it (by the first one after it where there is none before).
    bridged : ndarray of bool, shape (n_samples,)
        True at each sample that was reached over missing ones: by a replaced velocity, or by a
        step longer than 1.5 median periods.
    """
    lost = ~np.isfinite(velocity_rad_s)
    steps = np.diff(time_s)
    bridged = np.zeros(len(time_s), dtype=bool)
    if bool(lost.all()):
        return np.full(len(time_s), np.nan), ~bridged
    last = np.maximum.accumulate(np.where(lost, -1, np.arange(len(time_s))))
    held = velocity_rad_s[np.where(last < 0, int(np.argmin(lost)), last)]
    angle = np.concatenate(([0.0], np.cumsum(held[:-1] * steps)))
    if len(steps):
        bridged[1:] = lost[:-1] | (steps > _BRIDGE * float(np.median(steps)))
    return angle, bridged


def velocity_slope(time_s: FloatArray, velocity_rad_s: FloatArray) -> FloatArray:
    """Return the acceleration that a velocity gives, without lag."""
    return fit_derivative(
        time_s,
        velocity_rad_s,
        derivative=1,
        degree=_VELOCITY_DEGREE,
        window_s=ACCELERATION_WINDOW_S,
    ).derivative


def angle_curvature(time_s: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Return the acceleration that a measured angle gives, without lag."""
    return fit_derivative(
        time_s, angle_rad, derivative=2, degree=_ANGLE_DEGREE, window_s=ACCELERATION_WINDOW_S
    ).derivative


def sampled_acceleration(
    time: FloatArray, velocity: FloatArray, angle: FloatArray, source: str
) -> tuple[FloatArray, str, float]:
    """Return the acceleration by velocity or measured angle, whichever has less noise."""
    by_velocity = fit_derivative(
        time, velocity, derivative=1, degree=_VELOCITY_DEGREE, window_s=ACCELERATION_WINDOW_S
    )
    if source != "velocity":
        by_angle = fit_derivative(
            time, angle, derivative=2, degree=_ANGLE_DEGREE, window_s=ACCELERATION_WINDOW_S
        )
        # false where either is unknown (NaN): the velocity is then kept
        if by_angle.noise_std < by_velocity.noise_std:
            return by_angle.derivative, "angle", by_angle.noise_std
    return by_velocity.derivative, "velocity", by_velocity.noise_std
