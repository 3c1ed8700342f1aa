"""The filter over a stored trace."""

from __future__ import annotations

import numpy as np

from hdbench.errors import DataError
from hdbench.filter.model import FilterModel
from hdbench.filter.online import FilteredBlock, OnlineFilter
from hdbench.records import Trace

__all__ = ["OUTPUT_COLUMNS", "filter_trace", "filtered_columns"]

OUTPUT_COLUMNS = (
    "time_s",
    "torque_nm",
    "torque_expected_nm",
    "ripple_nm",
    "misalignment_nm",
    "torque_filtered_nm",
)


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
    if model.use_measured_angle:
        if "motor_angle_rad" in trace:
            angle = trace["motor_angle_rad"]
        elif "encoder_count" in trace and encoder_counts_per_turn is not None:
            angle = trace["encoder_count"] * (2.0 * np.pi / encoder_counts_per_turn)
    try:
        return OnlineFilter(model).process(trace.time_s, velocity, trace["torque_nm"], angle)
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
        The channels of `OUTPUT_COLUMNS`, in that order; NaN where a sample was lost.
    """
    return Trace(
        {
            "time_s": trace.time_s,
            "torque_nm": trace["torque_nm"],
            "torque_expected_nm": block.torque_expected_nm,
            "ripple_nm": block.ripple_nm,
            "misalignment_nm": block.misalignment_nm,
            "torque_filtered_nm": block.torque_filtered_nm,
        },
        source=trace.source,
    )
