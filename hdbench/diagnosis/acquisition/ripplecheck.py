"""What the ripple in the torque says of an angle, a velocity and their signs."""

from __future__ import annotations

import numpy as np

from hdbench.diagnosis.acquisition.channels import Shaft, velocity_of
from hdbench.diagnosis.measured.record import torque_from_trace
from hdbench.model import baseline_orders, integrate_velocity
from hdbench.model.localfit import fit_derivative
from hdbench.model.motion import ACCELERATION_WINDOW_S
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = ["RIGHT", "WRONG", "drive_sign", "explained", "swapped"]

# share of the torque's variance that the ripple explains on the right angle, and on a wrong one
RIGHT = 0.3
WRONG = 0.03
# samples of the running mean that takes slow torque out: some periods of ripple at walking pace
_SLOW = 301
# rad/s: what turns slower makes no ripple that is fast against the running mean
_TURNING = 10.0


def explained(torque: FloatArray, angle: FloatArray, orders: tuple[float, ...]) -> float:
    """Return the share of the fast torque's variance that ripple over this angle explains.

    Parameters
    ----------
    torque : ndarray, shape (n,)
        Torque, N m; NaN where lost.
    angle : ndarray, shape (n,)
        Motor angle, rad.
    orders : tuple of float
        Motor orders of the ripple.

    Returns
    -------
    float
        At most 1; 0 on fewer than some 1200 samples.
    """
    good = np.isfinite(torque) & np.isfinite(angle)
    if int(good.sum()) < 4 * _SLOW:
        return 0.0
    waves = [wave(order * angle[good]) for order in orders for wave in (np.cos, np.sin)]
    design = np.column_stack([_fast(wave) for wave in waves])
    response = _fast(torque[good])
    power = float(response @ response)
    left = response - design @ np.linalg.lstsq(design, response, rcond=None)[0]
    return 1.0 - float(left @ left) / power if power > 0.0 else 0.0


def _fast(values: FloatArray) -> FloatArray:
    """Return values less their running mean, twice: load, gravity and misalignment are slow.

    The ends, where the mean is one-sided, are left out.
    """
    from scipy.ndimage import uniform_filter1d

    for _ in range(2):
        values = values - uniform_filter1d(values, min(_SLOW, len(values)))
    return values[_SLOW:-_SLOW]


def swapped(trace: Trace, profile: ProfileData) -> bool:
    """Return whether torque and velocity stand in each other's place.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Gains.

    Returns
    -------
    bool
        True where the ripple is in the velocity, over the integral of the torque, and not the
        other way round.
    """
    velocity = velocity_of(trace, profile)
    if velocity is None:
        return False
    torque, orders = torque_from_trace(trace, profile), baseline_orders(profile)
    if "tacho_v" in trace and "torque_v" in trace:
        fast = trace["torque_v"] * profile.tacho.gain_rad_s_per_v
        slow = trace["tacho_v"] * profile.sensor.gain_nm_per_v
    else:
        fast, slow = torque, velocity
    known = np.abs(fast[np.isfinite(fast)])
    if not (len(known) and float(np.median(known)) > _TURNING):
        return False
    angle = integrate_velocity(trace.time_s, velocity)[0]
    other = integrate_velocity(trace.time_s, fast)[0]
    crossed = explained(slow, other, orders)
    return crossed > RIGHT and explained(torque, angle, orders) < WRONG


def drive_sign(trace: Trace, profile: ProfileData, shaft: Shaft) -> tuple[float, float]:
    """Return the coefficient of the velocity's expected torque and its standard uncertainty.

    Parameters
    ----------
    trace : Trace
        Torque.
    profile : ProfileData
        Inertia.
    shaft : Shaft
        Angle and velocity.

    Returns
    -------
    coefficient, std : float
        1 where the velocity has the right sign, -1 where it has the other.
    """
    slope = fit_derivative(
        shaft.time_s, shaft.velocity_rad_s, derivative=1, degree=3, window_s=ACCELERATION_WINDOW_S
    ).derivative
    drive = profile.drive
    expected = drive.load_inertia_kg_m2 / drive.gear_ratio * slope
    torque = torque_from_trace(trace, profile)
    good = np.isfinite(torque) & np.isfinite(expected) & np.isfinite(shaft.angle_rad)
    if int(good.sum()) < 4 * _SLOW:
        return 0.0, np.inf
    waves = [
        wave(order * shaft.angle_rad[good])
        for order in baseline_orders(profile)
        for wave in (np.cos, np.sin)
    ]
    design = np.column_stack([_fast(expected[good]), *(_fast(wave) for wave in waves)])
    response = _fast(torque[good])
    inverse = np.linalg.pinv(design.T @ design)
    solution = inverse @ (design.T @ response)
    left = response - design @ solution
    freedom = max(1, len(response) - design.shape[1])
    std = float(np.sqrt(max(0.0, float(inverse[0, 0])) * float(left @ left) / freedom))
    return float(solution[0]), std if std > 0.0 else np.inf
