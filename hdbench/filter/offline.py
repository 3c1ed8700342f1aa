"""The filter over a stored trace."""

from __future__ import annotations

from hdbench.errors import DataError
from hdbench.filter.channels import filter_channels
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
