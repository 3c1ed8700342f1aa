"""Angle and velocity of a trace side by side, and traces with one of them put right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.acquisition.stamps import gap_steps
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = [
    "ANGLE_COLUMNS",
    "VELOCITY_COLUMNS",
    "Shaft",
    "later_from",
    "robust_std",
    "scaled_velocity",
    "shaft_of",
    "turned_back",
    "velocity_of",
    "without_angle",
]

ANGLE_COLUMNS = ("motor_angle_rad", "encoder_count")
# of an angle in rad: 2^30 steps per turn are coarser, rounding of 8-byte numbers is far finer
_ANGLE_DECIMALS = 9
VELOCITY_COLUMNS = ("motor_velocity_rad_s", "tacho_v")


@dataclass(frozen=True, slots=True)
class Shaft:
    """Increments of the motor angle by encoder and by tacho, from each sample to the next.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Time, s.
    angle_rad : ndarray, shape (n,)
        Measured motor angle, rad.
    velocity_rad_s : ndarray, shape (n,)
        Measured motor velocity, rad/s.
    by_encoder_rad, by_tacho_rad : ndarray, shape (n - 1,)
        Increments, rad; the tacho's by the trapezoidal rule.
    good : ndarray of bool, shape (n - 1,)
        Increments between present neighbours without a gap.
    count_rad : float
        Smallest step of the measured angle, rad; next to 0 where it has none.
    tacho_step_rad_s : float
        Smallest change that the velocity shows, rad/s.
    """

    time_s: FloatArray
    angle_rad: FloatArray
    velocity_rad_s: FloatArray
    by_encoder_rad: FloatArray
    by_tacho_rad: FloatArray
    good: NDArray[np.bool_]
    count_rad: float
    tacho_step_rad_s: float


def robust_std(values: FloatArray) -> float:
    """Return the robust standard deviation of values about their median.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Values.

    Returns
    -------
    float
        Half width that holds 68.27 % of them: the standard deviation of normal ones; 0 of none.
    """
    if not len(values):
        return 0.0
    return float(np.quantile(np.abs(values - np.median(values)), 0.6827))


def velocity_of(trace: Trace, profile: ProfileData) -> FloatArray | None:
    """Return the measured motor velocity.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Tacho gain.

    Returns
    -------
    ndarray, shape (n,), or None
        rad/s; None where the trace has none.
    """
    if "motor_velocity_rad_s" in trace:
        return trace["motor_velocity_rad_s"]
    return trace["tacho_v"] * profile.tacho.gain_rad_s_per_v if "tacho_v" in trace else None


def shaft_of(trace: Trace, profile: ProfileData) -> Shaft | None:
    """Return angle and velocity side by side.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Tacho gain and encoder counts.

    Returns
    -------
    Shaft or None
        None where the trace lacks an angle or a velocity.
    """
    count = 2.0 * np.pi / profile.encoder.counts_per_turn
    if "motor_angle_rad" in trace:
        angle = trace["motor_angle_rad"]
    elif "encoder_count" in trace:
        angle = trace["encoder_count"] * count
    else:
        return None
    velocity = velocity_of(trace, profile)
    if velocity is None:
        return None
    time = trace.time_s
    by_encoder = np.diff(angle)
    by_tacho = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time)
    good = np.isfinite(by_encoder) & np.isfinite(by_tacho)
    good[gap_steps(time)] = False
    moves = np.abs(np.diff(velocity))
    moves = moves[np.isfinite(moves) & (moves > 0.0)]
    step = float(moves.min()) if len(moves) else 0.0
    return Shaft(time, angle, velocity, by_encoder, by_tacho, good, _count(by_encoder, count), step)


def _count(moves_rad: FloatArray, nominal_rad: float) -> float:
    """Return the step of an angle by the differences of its moves, at most the nominal one."""
    sizes = np.unique(np.round(moves_rad[np.isfinite(moves_rad)], _ANGLE_DECIMALS))
    return min(nominal_rad, float(np.diff(sizes).min())) if len(sizes) > 1 else nominal_rad


def turned_back(trace: Trace, profile: ProfileData, first: int, angle_rad: float) -> Trace:
    """Return the trace with the measured angle less `angle_rad` from one sample on.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Encoder counts.
    first : int
        First sample that moves.
    angle_rad : float
        Angle, rad.

    Returns
    -------
    Trace
    """
    scale = {
        "motor_angle_rad": 1.0,
        "encoder_count": profile.encoder.counts_per_turn / (2.0 * np.pi),
    }
    columns = {}
    for name in ANGLE_COLUMNS:
        if name in trace:
            moved = trace[name].copy()
            moved[first:] -= angle_rad * scale[name]
            columns[name] = moved
    return trace.with_columns(**columns)


def later_from(trace: Trace, first: int, delay_s: float) -> Trace:
    """Return the trace with every sample from one on later by `delay_s`.

    Parameters
    ----------
    trace : Trace
        Channels.
    first : int
        First sample that moves.
    delay_s : float
        Time, s.

    Returns
    -------
    Trace
        With a gap of that length before the sample.
    """
    time = trace.time_s.copy()
    time[first:] += delay_s
    return trace.with_columns(time_s=time)


def scaled_velocity(trace: Trace, factor: FloatArray | float) -> Trace:
    """Return the trace with its velocity times a factor.

    Parameters
    ----------
    trace : Trace
        Channels.
    factor : ndarray, shape (n,), or float
        Factor.

    Returns
    -------
    Trace
    """
    names = [name for name in VELOCITY_COLUMNS if name in trace]
    return trace.with_columns(**{name: np.asarray(trace[name] * factor) for name in names})


def without_angle(trace: Trace) -> Trace:
    """Return the trace without its motor angle, so that the velocity is integrated.

    Parameters
    ----------
    trace : Trace
        Channels.

    Returns
    -------
    Trace
    """
    kept = {name: v for name, v in trace.columns.items() if name not in ANGLE_COLUMNS}
    return Trace(kept, trace.source, trace.metadata)
