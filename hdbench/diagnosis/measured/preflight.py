"""Lost, clipped, stuck and spiky samples, found before anything is fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.acquisition.codes import clipped_samples, stuck_samples
from hdbench.diagnosis.acquisition.flags import DataFlag, flag_runs, flag_samples, mask_runs
from hdbench.diagnosis.acquisition.stamps import lost_flags, repeated_rows
from hdbench.diagnosis.measured.record import Record, torque_from_trace
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = [
    "DataFlag",
    "Preflight",
    "baseline_residual_nm",
    "find_spikes",
    "flag_samples",
    "inspect_trace",
    "robust_scatter_nm",
]

# a spike lasts this many samples at most, against the median of this many
_SPIKE_LENGTH = 2
_SPIKE_WINDOW = 5
# the largest of a million normal samples is twice the hundredth-largest of a hundred
_SPIKE_RATIO = 2.5
# a sample nearer than this to the rest, in units of its scatter, spoils no fit of thousands
_SPIKE_SIGMA = 5.0


@dataclass(frozen=True, slots=True)
class Preflight:
    """What the preflight found.

    Parameters
    ----------
    flags : tuple of DataFlag
        One for each kind of fault and stretch.
    masked : ndarray of bool, shape (n_samples,)
        Samples that no fit may use.
    """

    flags: tuple[DataFlag, ...]
    masked: NDArray[np.bool_]


def baseline_residual_nm(record: Record) -> FloatArray:
    """Return the residual of the baseline at the valid samples, by ordinary least squares.

    Parameters
    ----------
    record : Record
        Record.

    Returns
    -------
    ndarray, shape (n_valid,)
        N m.
    """
    design, response = record.base[record.valid], record.response_nm[record.valid]
    solution = np.linalg.lstsq(design, response, rcond=None)[0]
    return np.asarray(response - design @ solution)


def robust_scatter_nm(record: Record) -> float:
    """Return the robust scatter of the baseline's residual.

    Parameters
    ----------
    record : Record
        Record.

    Returns
    -------
    float
        N m; the standard deviation where the residual is normal.
    """
    left = baseline_residual_nm(record)
    # 68.27 % of a normal distribution lie within one standard deviation
    return float(np.quantile(np.abs(left - np.median(left)), 0.6827))


def find_spikes(record: Record) -> NDArray[np.bool_]:
    """Return isolated samples far outside of the residual around them.

    Parameters
    ----------
    record : Record
        Record; its baseline is fitted by ordinary least squares and taken out first, so that fast
        ripple is no spike.

    Returns
    -------
    ndarray of bool, shape (n_samples,)
        True at runs of one or two samples that differ from the median of five by 2.5 times what
        one sample in a hundred does: 6.4 standard deviations of normal noise, and more than any
        sinusoid, whose largest and hundredth-largest samples are almost alike.
    """
    from scipy.ndimage import median_filter

    far = np.zeros(len(record.valid), dtype=bool)
    index = np.flatnonzero(record.valid)
    if len(index) < 10 * _SPIKE_WINDOW:
        return far
    left = baseline_residual_nm(record)
    away = np.abs(left - median_filter(left, size=_SPIKE_WINDOW, mode="nearest"))
    limit = _SPIKE_RATIO * float(np.quantile(away, 0.99))
    if not limit > 0.0:
        return far
    large = np.abs(left - np.median(left)) > _SPIKE_SIGMA * robust_scatter_nm(record)
    far[index[(away > limit) & large]] = True
    for first, last in mask_runs(far):
        if last - first + 1 > _SPIKE_LENGTH:
            far[first : last + 1] = False
    return far


def inspect_trace(trace: Trace, profile: ProfileData) -> Preflight:
    """Find gaps, samples that repeat the one before, clipping and stuck values.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Converter range and resolution, sensor gain.

    Returns
    -------
    Preflight
        Clipped, repeated and stuck samples are masked; lost ones have no value anyway. Nothing is
        repaired.

    Raises
    ------
    DataError
        If the trace has no torque.
    """
    time, torque = trace.time_s, torque_from_trace(trace, profile)
    present = np.isfinite(torque)
    clipped = clipped_samples(trace, profile, torque)
    stuck = stuck_samples(torque) & ~clipped & present
    held = repeated_rows(trace) & ~clipped & ~stuck
    flags = [
        *lost_flags(trace),
        *flag_runs("missed-samples", time, held),
        *flag_samples("saturation", time, clipped),
        *flag_samples("stuck-value", time, stuck),
    ]
    return Preflight(tuple(flags), clipped | stuck | held)
