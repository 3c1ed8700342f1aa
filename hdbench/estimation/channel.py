"""The torque channel of a trace in N m, and what makes its samples doubtful."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import DataError
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import TorqueScale
from hdbench.records.trace import FloatArray, Trace
from hdbench.results.parts import DataFlag

__all__ = ["data_flags", "stretch_starts", "torque_channel"]

# a step of time above this many median periods is a gap: jitter of a foreign log stays below
_GAP_PERIODS = 2.5


def torque_channel(trace: Trace, scale: TorqueScale) -> FloatArray:
    """Return the measured torque.

    Parameters
    ----------
    trace : Trace
        With ``torque_nm`` or ``torque_v``.
    scale : TorqueScale
        Gain for volts, or the gain that made ``torque_nm`` of them.

    Returns
    -------
    ndarray, shape (n,)
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
        return scale.gain_nm_per_v.value * trace["torque_v"]
    raise DataError(
        f"the trace has no torque channel; found columns {', '.join(trace.columns)}, "
        "needed torque_v (V) or torque_nm (N m)",
        where=trace.source,
        fix="name the torque column when importing: --map torque_nm=COLUMN",
    )


def stretch_starts(time_s: FloatArray) -> NDArray[np.bool_]:
    """Return where a sample does not follow its predecessor in time.

    Parameters
    ----------
    time_s : ndarray, shape (n,)
        Time, s, strictly increasing.

    Returns
    -------
    ndarray of bool, shape (n,)
        True where the step of time exceeds 2.5 median steps.
    """
    starts = np.zeros(len(time_s), dtype=bool)
    step = np.diff(time_s)
    if len(step):
        starts[1:] = step > _GAP_PERIODS * np.median(step)
    return starts


def data_flags(trace: Trace, torque_nm: FloatArray, profile: ProfileData) -> tuple[DataFlag, ...]:
    """Return what makes a trace doubtful: missing samples, gaps in time, saturation.

    Parameters
    ----------
    trace : Trace
        The trace.
    torque_nm : ndarray, shape (n,)
        Its torque channel, N m.
    profile : ProfileData
        Range and resolution of the converter.

    Returns
    -------
    tuple of DataFlag
        Empty where nothing was found.
    """
    flags: list[DataFlag] = []
    missing = int(np.count_nonzero(~np.isfinite(torque_nm)))
    if missing:
        flags.append(DataFlag("missing-samples", missing, f"{missing} samples without a torque"))
    gaps = int(np.count_nonzero(stretch_starts(trace.time_s)))
    if gaps:
        flags.append(DataFlag("gap", gaps, f"{gaps} steps of time above 2.5 median periods"))
    if "torque_v" in trace:
        # the last two codes of the converter: a reading there may be any larger voltage
        step_v = 2.0 * profile.daq.range_v / 2**profile.daq.resolution_bits
        end_v = profile.daq.range_v - 2.0 * step_v
        clipped = int(np.count_nonzero(np.abs(trace["torque_v"]) >= end_v))
        if clipped:
            detail = f"{clipped} torque samples at the end of +-{profile.daq.range_v} V"
            flags.append(DataFlag("saturation", clipped, detail))
    return tuple(flags)
