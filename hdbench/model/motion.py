"""Motion of a record: angles, velocity and a lag-free acceleration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import DataError
from hdbench.model.localfit import fit_derivative, smoothed
from hdbench.profile.scaling import angle_channel, torque_channel, velocity_channel
from hdbench.profile.schema import Drive, ProfileData
from hdbench.records.trace import FloatArray, Trace


def gauge_order_factor(drive: Drive) -> float:
    r"""Return the factor from orders relative to the gauges to motor orders.

    Parameters
    ----------
    drive : Drive
        Gear ratio and whether the flexspline with its gauges stands or turns.

    Returns
    -------
    float
        1 on a standing flexspline. On a turning one :math:`1 + 1/N`: the gauges turn against the
        wave generator, so that it passes them oftener.
    """
    return 1.0 if drive.flexspline == "standing" else 1.0 + 1.0 / drive.gear_ratio


# channels of the torque
TORQUES = ("torque_nm", "torque_v")
# window of the acceleration: 20 ms hold 21 samples at 1 kHz, which leaves J/N times the noise near
# 1 mN m with the profile's tacho, and passes a 10 Hz motion to within 0.1 %
ACCELERATION_WINDOW_S = 0.020
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


# degrees whose derivative at the centre of the window is exact for cubic velocity
_by_velocity = partial(fit_derivative, derivative=1, degree=3, window_s=ACCELERATION_WINDOW_S)
_by_angle = partial(fit_derivative, derivative=2, degree=4, window_s=ACCELERATION_WINDOW_S)


def velocity_slope(time_s: FloatArray, velocity_rad_s: FloatArray) -> FloatArray:
    """Return the acceleration that a velocity gives, without lag."""
    return _by_velocity(time_s, velocity_rad_s).derivative


def angle_curvature(time_s: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Return the acceleration that a measured angle gives, without lag."""
    return _by_angle(time_s, angle_rad).derivative


def sampled_acceleration(
    time: FloatArray, velocity: FloatArray, angle: FloatArray, source: str
) -> tuple[FloatArray, str, float]:
    """Return the acceleration by velocity or measured angle, whichever has less noise."""
    by_velocity = _by_velocity(time, velocity)
    if source != "velocity":
        by_angle = _by_angle(time, angle)
        # false where either is unknown (NaN): the velocity is then kept
        if by_angle.noise_std < by_velocity.noise_std:
            return by_angle.derivative, "angle", by_angle.noise_std
    return by_velocity.derivative, "velocity", by_velocity.noise_std


# degree of the polynomial that smooths a measured load: passes a ramp and a bend
_LOAD_DEGREE = 2
# an expected torque nearer than this many standard deviations to its own noise is noise to causes
_ABOVE_NOISE = 10.0


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion at every sample of a record; arrays of shape (n_samples,).

    Parameters
    ----------
    time_s : ndarray
        Time, s.
    velocity_rad_s : ndarray
        Velocity of the wave generator, rad/s; NaN at lost samples.
    angle_rad : ndarray
        Angle of the wave generator, rad.
    acceleration_rad_s2 : ndarray
        Acceleration of the wave generator, rad/s^2, without lag; NaN at lost samples.
    output_angle_rad : ndarray
        Angle of the output, rad: measured, or motor angle over gear ratio.
    valid : ndarray of bool
        True where every quantity above is there.
    angle_source : str
        ``motor_angle_rad``, ``encoder_count`` or ``velocity``.
    gear_ratio : float
        N, motor turns per output turn.
    acceleration_source : str
        ``angle`` or ``velocity``: what was differentiated.
    acceleration_noise_rad_s2 : float
        Standard deviation of the acceleration's noise, rad/s^2, from the scatter of the samples.
    output_source : str
        ``output_angle_rad`` where measured, else ``motor``.
    bridged : ndarray of bool or None
        True where the integrated angle stepped over missing samples with the last velocity; None
        where the angle is measured.
    gauge_factor : float
        Motor orders per order relative to the gauges: 1, or 1 + 1/N on a turning flexspline.
    load_torque_nm, motor_current_a, temperature_c : ndarray or None
        Further channels of the record; None where it has none.
    inertia_nm_s2 : float
        J_load/N, N m per rad/s^2 of the motor.
    starts : ndarray of bool or None
        True where a sample does not follow its predecessor, so that nothing that remembers is
        carried over; None where only the first sample is such a start.
    simulated_nm : ndarray or None
        Torque of the fitted or given baseline, N m, for causes that act on the whole signal (a time
        skew, a saturation); None where no baseline is known yet.
    load_smooth_nm : ndarray or None
        `load_torque_nm` without its fast noise, N m, for causes: the same noise stands in the
        residual, and what is made of it would find itself there. None where the load is exact.
    ripple_slope_nm_per_rad : ndarray or None
        Change of `simulated_nm` with the motor angle alone, N m/rad, for causes that are an error
        of that angle; None where `simulated_nm` is, or is given without it.
    angle_error_rad : ndarray or None
        Error of `angle_rad`, rad, for causes that follow the true angle; None where none is known.
    shown_by_angle : callable or None
        What `acceleration_rad_s2` shows of an error of the angle, rad at every sample; None where
        it is the second derivative.
    """

    time_s: FloatArray
    velocity_rad_s: FloatArray
    angle_rad: FloatArray
    acceleration_rad_s2: FloatArray
    output_angle_rad: FloatArray
    valid: NDArray[np.bool_]
    angle_source: str
    gear_ratio: float
    acceleration_source: str = "velocity"
    acceleration_noise_rad_s2: float = 0.0
    output_source: str = "motor"
    bridged: NDArray[np.bool_] | None = None
    gauge_factor: float = 1.0
    load_torque_nm: FloatArray | None = None
    motor_current_a: FloatArray | None = None
    temperature_c: FloatArray | None = None
    inertia_nm_s2: float = 0.0
    starts: NDArray[np.bool_] | None = None
    simulated_nm: FloatArray | None = None
    load_smooth_nm: FloatArray | None = None
    ripple_slope_nm_per_rad: FloatArray | None = None
    angle_error_rad: FloatArray | None = None
    shown_by_angle: Callable[[FloatArray], FloatArray] | None = None

    @property
    def applied_nm(self) -> FloatArray:
        """Known torque through the flexspline, N m: measured load (if any) and expected torque.

        Both without their noise, which stands in the residual too: the load smoothed, the expected
        torque only where the acceleration stands out.
        """
        floor = _ABOVE_NOISE * self.acceleration_noise_rad_s2
        quiet = np.abs(self.acceleration_rad_s2) <= floor
        expected = self.inertia_nm_s2 * np.where(quiet, 0.0, self.acceleration_rad_s2)
        load = self.load_torque_nm if self.load_smooth_nm is None else self.load_smooth_nm
        return expected if load is None else expected + load

    def __len__(self) -> int:
        return len(self.time_s)


def turns_of(angle_rad: FloatArray, motion: Motion) -> float:
    """Return the span of an angle over the valid samples, turns."""
    return float(np.ptp(angle_rad[motion.valid])) / (2.0 * np.pi) if motion.valid.any() else 0.0


def motion_from_trace(trace: Trace, profile: ProfileData) -> Motion:
    """Return the motion that a trace holds.

    Parameters
    ----------
    trace : Trace
        Channels; needs ``motor_velocity_rad_s`` or ``tacho_v`` and at least five samples.
    profile : ProfileData
        Gear ratio, tacho gain and encoder counts.

    Returns
    -------
    Motion
        Angle from ``motor_angle_rad``, else ``encoder_count``, else the integrated velocity.

    Raises
    ------
    DataError
        If a channel is missing, times do not increase, or fewer than five samples are present.

    Notes
    -----
    The acceleration is the first derivative of a cubic fitted to the velocity, or the second
    derivative of a quartic fitted to the measured angle, over 20 ms around each sample (at least
    seven samples): whichever has less noise by the scatter of its own samples. Nothing is
    interpolated: a lost sample has no velocity, no acceleration and is not valid.
    """
    time = _checked_time(trace)
    velocity = velocity_channel(trace, profile)
    angle, source, bridged = _angle(trace, profile, velocity)
    measured_output = trace.columns.get("output_angle_rad")
    output = angle / profile.drive.gear_ratio if measured_output is None else measured_output
    acceleration, from_what, noise = sampled_acceleration(time, velocity, angle, source)
    valid = np.isfinite(velocity) & np.isfinite(angle) & np.isfinite(output)
    valid &= np.isfinite(acceleration)
    load = smooth = trace.columns.get("load_torque_nm")
    if load is not None:
        smooth = smoothed(time, load, degree=_LOAD_DEGREE, window_s=ACCELERATION_WINDOW_S)
    if int(valid.sum()) < 5:
        raise DataError(
            f"{int(valid.sum())} of {len(time)} samples have a motion; needed: at least 5",
            where=f"{trace.source}: velocity and angle",
            fix="give a record with at least five neighbouring samples that are present",
        )
    return Motion(
        time,
        velocity,
        angle,
        acceleration,
        output,
        valid,
        source,
        profile.drive.gear_ratio,
        from_what,
        noise,
        "motor" if measured_output is None else "output_angle_rad",
        bridged,
        gauge_order_factor(profile.drive),
        load,
        trace.columns.get("motor_current_a"),
        trace.columns.get("temperature_c"),
        profile.drive.load_inertia_kg_m2 / profile.drive.gear_ratio,
        load_smooth_nm=smooth,
    )


def torque_from_trace(trace: Trace, profile: ProfileData) -> FloatArray:
    """Return the torque of a trace, N m: its column, or volts times the profile's gain."""
    return torque_channel(trace, profile.sensor.gain_nm_per_v)


def _checked_time(trace: Trace) -> FloatArray:
    """Return the times after making sure that they are finite and increase."""
    time = trace.time_s
    good = np.isfinite(time)
    good[1:] &= np.diff(time) > 0.0
    if not bool(good.all()):
        at = int(np.argmin(good))
        raise DataError(
            f"time_s is {time[at]!r} at sample {at}; needed: finite and above the sample before",
            where=f"{trace.source}: column time_s, sample {at}",
            fix="sort the samples by time and remove repeated ones",
        )
    return time


def _angle(
    trace: Trace, profile: ProfileData, velocity: FloatArray
) -> tuple[FloatArray, str, NDArray[np.bool_] | None]:
    """Return the motor angle, where it came from, and where it stepped over a gap."""
    measured = angle_channel(trace, profile)
    if measured is not None:
        source = "motor_angle_rad" if "motor_angle_rad" in trace else "encoder_count"
        return measured, source, None
    angle, bridged = integrate_velocity(trace.time_s, velocity)
    return angle, "velocity", bridged
