"""Stored traces through the filter: the channels that it reads, and the columns that it gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdbench.errors import DataError
from hdbench.filter.kalman import FilteredBlock, new_state, pack, run
from hdbench.filter.model import FilterModel
from hdbench.filter.online import OnlineFilter
from hdbench.records import FloatArray, Trace


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


def run_channels(model: FilterModel, channels: Channels) -> FilteredBlock:
    """Filter channels as they stand, from the start of the model."""
    packed = pack(model)
    samples = (channels.time_s, channels.velocity_rad_s, channels.torque_nm)
    return run(packed, new_state(packed), *samples, angle_rad=channels.angle_rad)


def filter_trace(
    trace: Trace,
    model: FilterModel,
    *,
    velocity_gain_rad_s_per_v: float,
    encoder_counts_per_turn: int | None = None,
) -> FilteredBlock:
    """Filter a stored trace as it would have been filtered while sampling.

    Parameters
    ----------
    trace : Trace
        With ``torque_nm`` and ``motor_velocity_rad_s`` or ``tacho_v``.
    model : FilterModel
        Orders, noise and expected torque.
    velocity_gain_rad_s_per_v : float
        Motor speed per tacho volt, rad/s/V; used where there is no ``motor_velocity_rad_s``.
    encoder_counts_per_turn : int or None
        Turns ``encoder_count`` into an angle where the model uses a measured one and there is no
        ``motor_angle_rad``.

    Returns
    -------
    FilteredBlock
        One value per sample; the same bits as `OnlineFilter` on blocks of any length.

    Raises
    ------
    DataError
        If a channel is missing or time does not increase.
    """
    channels = filter_channels(
        trace,
        use_measured_angle=model.use_measured_angle,
        velocity_gain_rad_s_per_v=velocity_gain_rad_s_per_v,
        encoder_counts_per_turn=encoder_counts_per_turn,
    )
    try:
        return OnlineFilter(model).process(
            channels.time_s, channels.velocity_rad_s, channels.torque_nm, channels.angle_rad
        )
    except DataError as error:
        raise DataError(
            error.what, where=f"{trace.source}: {error.where}", fix=error.fix
        ) from error


def filtered_columns(trace: Trace, block: FilteredBlock) -> Trace:
    """Return what `hdbench filter` writes: the torque and what the filter says about it.

    Parameters
    ----------
    trace : Trace
        The trace that was filtered, with ``torque_nm``.
    block : FilteredBlock
        The filter's answer to it.

    Returns
    -------
    Trace
        Time, torque, expected torque, ripple, misalignment, filtered torque; NaN where a sample
        was lost.
    """
    names = ("torque_expected_nm", "ripple_nm", "misalignment_nm", "torque_filtered_nm")
    columns = {name: getattr(block, name) for name in names}
    return Trace(
        {"time_s": trace.time_s, "torque_nm": trace["torque_nm"], **columns}, source=trace.source
    )
