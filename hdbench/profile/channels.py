"""Torque and motion of a trace in SI units: its columns, or its volts and counts by the profile."""

from __future__ import annotations

import math

from hdbench.errors import DataError
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace


def torque_channel(trace: Trace, gain_nm_per_v: float) -> FloatArray:
    """Return the measured torque.

    Parameters
    ----------
    trace : Trace
        With ``torque_nm`` or ``torque_v``.
    gain_nm_per_v : float
        Torque per volt, N m/V.

    Returns
    -------
    ndarray, shape (n_samples,)
        Torque, N m; NaN where a sample is missing.

    Raises
    ------
    DataError
        If the trace has neither channel.

    Notes
    -----
    ``torque_nm`` is taken as it stands; without it ``torque_nm = gain_nm_per_v * torque_v``. Who
    wants another gain for a trace that holds both writes ``torque_nm`` anew from ``torque_v``.
    """
    if "torque_nm" in trace:
        return trace["torque_nm"]
    if "torque_v" in trace:
        return trace["torque_v"] * gain_nm_per_v
    raise _missing(trace, "torque", "torque_nm in N m, or torque_v in V")


def velocity_channel(trace: Trace, profile: ProfileData) -> FloatArray:
    """Return the motor velocity, rad/s: measured, or by the tacho's volts; DataError without."""
    if "motor_velocity_rad_s" in trace:
        return trace["motor_velocity_rad_s"]
    if "tacho_v" in trace:
        return trace["tacho_v"] * profile.tacho.gain_rad_s_per_v
    raise _missing(trace, "velocity", "motor_velocity_rad_s in rad/s, or tacho_v in V")


def angle_channel(trace: Trace, profile: ProfileData) -> FloatArray | None:
    """Return the measured motor angle, rad: its column or counts; None where there is neither."""
    if "motor_angle_rad" in trace:
        return trace["motor_angle_rad"]
    count_rad = 2.0 * math.pi / profile.encoder.counts_per_turn
    return trace["encoder_count"] * count_rad if "encoder_count" in trace else None


def _missing(trace: Trace, what: str, needed: str) -> DataError:
    column = needed.partition(" ")[0]
    return DataError(
        f"the trace has no {what} channel; found columns {', '.join(trace.columns)}, needed: "
        f"{needed}",
        where=trace.source,
        fix=f"name the column when importing: hdbench import --map {column}=COLUMN",
    )
