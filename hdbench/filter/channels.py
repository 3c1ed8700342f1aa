"""Which channels of a trace the filter reads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.errors import DataError
from hdbench.records import FloatArray, Trace

__all__ = ["Channels", "filter_channels"]


@dataclass(frozen=True, slots=True)
class Channels:
    """Samples as the filter takes them, arrays of shape (n,).

    Parameters
    ----------
    time_s : ndarray
        Sample times, s.
    velocity_rad_s : ndarray
        Motor velocity, rad/s; NaN where missing.
    torque_nm : ndarray
        Measured torque, N m; NaN where missing.
    angle_rad : ndarray or None
        Measured motor angle, rad, unwrapped; None where the velocity turns the blocks.
    source : str
        File of the trace, for messages.
    """

    time_s: FloatArray
    velocity_rad_s: FloatArray
    torque_nm: FloatArray
    angle_rad: FloatArray | None
    source: str


def filter_channels(
    trace: Trace,
    *,
    use_measured_angle: bool,
    velocity_gain_rad_s_per_v: float,
    encoder_counts_per_turn: int | None = None,
) -> Channels:
    """Return the channels that the filter reads.

    Parameters
    ----------
    trace : Trace
        With ``torque_nm`` and ``motor_velocity_rad_s`` or ``tacho_v``.
    use_measured_angle : bool
        Whether a measured motor angle is wanted where there is one.
    velocity_gain_rad_s_per_v : float
        Motor speed per tacho volt, rad/s/V; used where there is no ``motor_velocity_rad_s``.
    encoder_counts_per_turn : int or None
        Turns ``encoder_count`` into an angle where there is no ``motor_angle_rad``.

    Returns
    -------
    Channels
        The samples.

    Raises
    ------
    DataError
        If a channel is missing.
    """
    if "torque_nm" not in trace:
        raise DataError(
            "there is no channel torque_nm",
            where=trace.source,
            fix="give the torque in N m, or torque_v and a gain in N m/V",
        )
    if "motor_velocity_rad_s" in trace:
        velocity = trace["motor_velocity_rad_s"]
    elif "tacho_v" in trace:
        velocity = trace["tacho_v"] * velocity_gain_rad_s_per_v
    else:
        raise DataError(
            "there is neither motor_velocity_rad_s nor tacho_v",
            where=trace.source,
            fix="record the motor velocity or the tacho voltage; the filter needs one of them",
        )
    angle = None
    if use_measured_angle:
        if "motor_angle_rad" in trace:
            angle = trace["motor_angle_rad"]
        elif "encoder_count" in trace and encoder_counts_per_turn is not None:
            angle = trace["encoder_count"] * (2.0 * np.pi / encoder_counts_per_turn)
    return Channels(trace.time_s, velocity, trace["torque_nm"], angle, trace.source)
