"""Faults of the acquisition, found before anything is fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.record import Record, torque_from_trace
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = [
    "DataFlag",
    "Preflight",
    "find_spikes",
    "flag_samples",
    "inspect_trace",
    "robust_scatter_nm",
]

# a step longer than this many median periods is a gap: one lost sample makes 2
_GAP = 1.5
# more gaps than this are told as one flag over all of them
_MANY_GAPS = 20
# a spike lasts this many samples at most, against the median of this many
_SPIKE_LENGTH = 2
_SPIKE_WINDOW = 5
# the largest of a million normal samples is twice the hundredth-largest of a hundred
_SPIKE_RATIO = 2.5
# a sample nearer than this to the rest, in units of its scatter, spoils no fit of thousands
_SPIKE_SIGMA = 5.0
# the last code of a converter that clips holds this many times the samples of the code before it
_CLIP_RATIO = 5
_CLIP_LEAST = 5
# this many equal samples in a row do not come from a channel with noise
_STUCK = 20


@dataclass(frozen=True, slots=True)
class DataFlag:
    """A stretch of doubtful samples.

    Parameters
    ----------
    name : str
        ``missed-samples``, ``saturation``, ``spikes`` or ``stuck-value``.
    from_s, to_s : float
        First and last of them, s.
    samples : int
        How many.
    """

    name: str
    from_s: float
    to_s: float
    samples: int

    def to_dict(self) -> dict[str, object]:
        """Return the flag as the contract writes it."""
        return {
            "name": self.name,
            "from_s": self.from_s,
            "to_s": self.to_s,
            "samples": self.samples,
        }


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


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _lost(trace: Trace, time: FloatArray) -> list[DataFlag]:
    """Return runs of samples without a value and steps in time that lack samples."""
    names = [n for n in ("torque_nm", "torque_v", "motor_velocity_rad_s", "tacho_v") if n in trace]
    missing = ~trace.valid(*names)
    flags = [
        DataFlag("missed-samples", float(time[a]), float(time[b]), b - a + 1)
        for a, b in _runs(missing)
    ]
    steps = np.diff(time)
    period = float(np.median(steps))
    for at in np.flatnonzero(steps > _GAP * period):
        lost = max(1, round(float(steps[at]) / period) - 1)
        flags.append(DataFlag("missed-samples", float(time[at]), float(time[at + 1]), lost))
    flags.sort(key=lambda flag: flag.from_s)
    if len(flags) <= _MANY_GAPS:
        return flags
    total = sum(flag.samples for flag in flags)
    return [DataFlag("missed-samples", flags[0].from_s, flags[-1].to_s, total)]


def _clipped(trace: Trace, profile: ProfileData, torque: FloatArray) -> NDArray[np.bool_]:
    """Return samples at the end of the converter's range, or piled up at the extreme value."""
    clipped = np.zeros(len(torque), dtype=bool)
    if "torque_v" in trace:
        step = 2.0 * profile.daq.range_v / 2**profile.daq.resolution_bits
        clipped |= np.abs(trace["torque_v"]) >= profile.daq.range_v - 1.5 * step
    present = torque[np.isfinite(torque)]
    if len(present) < _STUCK:
        return clipped
    values, counts = np.unique(present, return_counts=True)
    for end, neighbours in ((0, counts[1:4]), (len(values) - 1, counts[-4:-1])):
        if len(neighbours) and counts[end] >= max(_CLIP_LEAST, _CLIP_RATIO * int(neighbours.max())):
            clipped |= torque == values[end]
    return clipped


def _stuck(torque: FloatArray) -> NDArray[np.bool_]:
    """Return samples in runs of equal values that noise cannot make."""
    same = np.zeros(len(torque), dtype=bool)
    if len(torque) < _STUCK or not np.nanstd(np.diff(torque)) > 0.0:
        return same
    equal = np.concatenate([[False], np.diff(torque) == 0.0])
    for first, last in _runs(equal):
        if last - first + 2 >= _STUCK:
            same[first - 1 : last + 1] = True
    return same


def _baseline_residual(record: Record) -> FloatArray:
    """Return the residual of the baseline at the valid samples, by ordinary least squares."""
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
    left = _baseline_residual(record)
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
    left = _baseline_residual(record)
    away = np.abs(left - median_filter(left, size=_SPIKE_WINDOW, mode="nearest"))
    limit = _SPIKE_RATIO * float(np.quantile(away, 0.99))
    if not limit > 0.0:
        return far
    large = np.abs(left - np.median(left)) > _SPIKE_SIGMA * robust_scatter_nm(record)
    far[index[(away > limit) & large]] = True
    for first, last in _runs(far):
        if last - first + 1 > _SPIKE_LENGTH:
            far[first : last + 1] = False
    return far


def flag_samples(name: str, time: FloatArray, mask: NDArray[np.bool_]) -> list[DataFlag]:
    """Return one flag for the marked samples, none where there are none.

    Parameters
    ----------
    name : str
        Name of the fault.
    time : ndarray, shape (n_samples,)
        Time, s.
    mask : ndarray of bool, shape (n_samples,)
        Marked samples.

    Returns
    -------
    list of DataFlag
        From the first to the last of them.
    """
    at = np.flatnonzero(mask)
    if not len(at):
        return []
    return [DataFlag(name, float(time[at[0]]), float(time[at[-1]]), len(at))]


def inspect_trace(trace: Trace, profile: ProfileData) -> Preflight:
    """Find gaps, clipping and stuck values.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Converter range and resolution, sensor gain.

    Returns
    -------
    Preflight
        Clipped and stuck samples are masked; lost ones have no value anyway. Nothing is
        repaired.

    Raises
    ------
    DataError
        If the trace has no torque.
    """
    time, torque = trace.time_s, torque_from_trace(trace, profile)
    present = np.isfinite(torque)
    clipped = _clipped(trace, profile, torque)
    stuck = _stuck(torque) & ~clipped & present
    flags = [
        *_lost(trace, time),
        *flag_samples("saturation", time, clipped),
        *flag_samples("stuck-value", time, stuck),
    ]
    return Preflight(tuple(flags), clipped | stuck)
