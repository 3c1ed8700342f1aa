"""One dynamic record as the diagnosis sees it: torque, motion, baseline and usable samples."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.measured.baselineterms import BaselineChange
from hdbench.diagnosis.measured.columnstore import ColumnStore
from hdbench.diagnosis.measured.drift import turned_motion, without_drift
from hdbench.diagnosis.measured.fixed import angle_noise, fast_noise, load_share
from hdbench.errors import DataError
from hdbench.model import BenchModel, Motion, baseline_columns, motion_from_trace
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = [
    "Beyond",
    "Record",
    "mask_samples",
    "prepare_record",
    "torque_from_trace",
    "with_simulated",
]

# a torque once per output turn this many times the model's, and this share of the rated torque, is
# another effect than the misalignment that the model means ...
_MISALIGNED = 5.0
_MISALIGNED_RATED = 0.1
# ... where it takes the residual down to less than half: a short arc fits noise with any amplitude
_CLEARLY = 2.0
# a step longer than this many median periods is a gap in time: one lost sample makes 2
_GAP = 1.5


@dataclass(frozen=True, slots=True)
class Beyond:
    """What was found beyond the baseline.

    Parameters
    ----------
    torque_nm : ndarray, shape (n_samples,)
        Torque of the effects that must not be taken for a drift of the angle, N m.
    orders : tuple of float
        Motor orders that carry such a drift; they are no part of `torque_nm`.
    """

    torque_nm: FloatArray
    orders: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Record:
    """A record ready for regression; arrays of shape (n_samples,).

    Parameters
    ----------
    motion : Motion
        Motion at every sample.
    torque_nm : ndarray
        Measured torque, N m; NaN where lost.
    valid : ndarray of bool
        Samples with torque and motion that are not masked.
    starts : ndarray of bool
        True where a sample does not follow its predecessor.
    fixed_nm : ndarray
        What the baseline holds fixed, N m.
    names : tuple of str
        Baseline terms with free coefficients.
    columns : ndarray, shape (n_samples, n_names)
        Their columns; zero where not valid.
    nuisance : ndarray, shape (n_samples, n_nuisance)
        Columns projected out beside the baseline: output order 1 on less than an output turn.
    period_s : float
        Median sampling period, s.
    load : float
        Coefficient of the measured load torque in `fixed_nm`.
    jitter : ndarray, shape (n_samples, n_jitter)
        Fast noise of the measured load and acceleration, N m, and what that of the angle makes of
        the ripple. It stands in the residual, and in all that is made of the same channels: it is
        projected out, so that nothing finds it there.
    weighty : bool
        True where the output covers less than a turn and carries a torque once per turn far beyond
        any misalignment.

    Notes
    -----
    ``base``, shape (n_samples, k), holds baseline, nuisance and jitter columns side by side, and
    ``kept`` the columns of the shapes that were asked for last.
    """

    motion: Motion
    torque_nm: FloatArray
    valid: NDArray[np.bool_]
    starts: NDArray[np.bool_]
    fixed_nm: FloatArray
    names: tuple[str, ...]
    columns: FloatArray
    nuisance: FloatArray
    period_s: float
    load: float
    jitter: FloatArray
    weighty: bool = False
    base: FloatArray = field(init=False, repr=False)
    kept: ColumnStore = field(init=False, repr=False, compare=False, default_factory=ColumnStore)

    def __post_init__(self) -> None:
        """Put baseline, nuisance and jitter columns side by side once."""
        base = np.hstack([self.columns, self.nuisance, self.jitter])
        base.flags.writeable = False
        object.__setattr__(self, "base", base)

    @property
    def response_nm(self) -> FloatArray:
        """Measured torque less what is fixed, N m, zero where not valid."""
        return np.where(self.valid, self.torque_nm - self.fixed_nm, 0.0)


def torque_from_trace(trace: Trace, profile: ProfileData) -> FloatArray:
    """Return the torque of a trace.

    Parameters
    ----------
    trace : Trace
        With ``torque_nm``, or ``torque_v`` that the profile's gain scales.
    profile : ProfileData
        Sensor gain.

    Returns
    -------
    ndarray, shape (n_samples,)
        Torque, N m.

    Raises
    ------
    DataError
        If the trace has neither column.
    """
    if "torque_nm" in trace:
        return trace["torque_nm"]
    if "torque_v" in trace:
        return np.asarray(trace["torque_v"] * profile.sensor.gain_nm_per_v)
    raise DataError(
        f"no torque among the columns {', '.join(trace.columns)}; needed: torque_nm in N m, or "
        "torque_v in V",
        where=f"{trace.source}: header",
        fix="add the column, or name it with `hdbench import --map torque_nm=COLUMN`",
    )


def prepare_record(
    trace: Trace,
    profile: ProfileData,
    model: BenchModel,
    masked: NDArray[np.bool_],
    beyond: Beyond | None = None,
    change: BaselineChange | None = None,
) -> Record:
    """Return the record with its baseline.

    Parameters
    ----------
    trace : Trace
        Channels.
    profile : ProfileData
        Bench.
    model : BenchModel
        Model whose misalignment is held fixed where the output covers less than a turn.
    masked : ndarray of bool, shape (n_samples,)
        Samples that the preflight took out.
    beyond : Beyond or None
        Effects beyond the baseline, for the drift of an integrated angle; none where None.
    change : BaselineChange or None
        What is added to the baseline and taken out of it; nothing where None.

    Returns
    -------
    Record

    Raises
    ------
    DataError
        If a channel is missing or the motion cannot be formed.

    Notes
    -----
    On less than an output turn the once-per-turn torque, the zero and slow changes look alike:
    it is then subtracted with the model's numbers and what is left of it projected out, so that
    a bench whose misalignment differs from its profile raises no alarm there. A torque far beyond
    any misalignment, as of an arm's weight, is left for the search to name.

    An angle that is integrated from the velocity by the contract's rule lies half a sample behind
    the shaft wherever the speed changes. Where the baseline fits better with the half sample put
    back, the diagnosis uses that angle. The noise of the velocity makes it drift: `without_drift`.
    """
    torque = torque_from_trace(trace, profile)
    motion = _aligned(motion_from_trace(trace, profile), profile, torque, masked, beyond)
    if any(term.name == "transmission-error" for term in model.causes):
        slope = model.signal_motion(motion).ripple_slope_nm_per_rad
        motion = replace(motion, ripple_slope_nm_per_rad=slope)
    change = change or BaselineChange()
    load = 0.0 if "load" in change.without else load_share(motion, profile, torque, masked)
    fixed, names, columns = baseline_columns(motion, profile, load=load)
    whole_turn = "misalignment:cosine" in names
    fixed, names, columns = change.apply(motion, fixed, names, columns)
    nuisance = np.zeros((len(torque), 0))
    weighty = False
    if not whole_turn and "misalignment" not in change.without:
        amplitude, phase = model.misalignment
        fixed = fixed + amplitude * np.cos(motion.output_angle_rad + phase)
        once = np.column_stack([np.cos(motion.output_angle_rad), np.sin(motion.output_angle_rad)])
        usable = motion.valid & np.isfinite(torque - fixed) & ~masked
        largest = max(_MISALIGNED * amplitude, _MISALIGNED_RATED * profile.drive.rated_torque_nm)
        weighty = _far_off(columns[usable], once[usable], (torque - fixed)[usable], largest)
        nuisance = nuisance if weighty else once
    valid = motion.valid & np.isfinite(torque) & np.isfinite(fixed) & ~masked
    valid &= np.isfinite(columns).all(axis=1) & np.isfinite(nuisance).all(axis=1)
    steps = np.diff(motion.time_s)
    period = float(np.median(steps))
    starts = np.concatenate([[True], steps > _GAP * period])
    jitter = np.hstack([fast_noise(motion, load), angle_noise(motion, names, columns)])
    return Record(
        motion,
        torque,
        valid,
        starts,
        fixed,
        names,
        np.where(valid[:, None], columns, 0.0),
        np.where(valid[:, None], nuisance, 0.0),
        period,
        load,
        np.where(valid[:, None], jitter, 0.0),
        weighty,
    )


def _far_off(
    columns: FloatArray, once: FloatArray, response: FloatArray, largest_nm: float
) -> bool:
    """Return whether the torque once per output turn is none that the model can have meant.

    An arm's weight is: it is then looked for as an effect instead of being projected out.
    """
    design = np.hstack([columns, once])
    if len(response) <= design.shape[1]:
        return False
    without = response - columns @ np.linalg.lstsq(columns, response, rcond=None)[0]
    solution = np.linalg.lstsq(design, response, rcond=None)[0]
    left = response - design @ solution
    size = float(np.hypot(solution[-2], solution[-1]))
    return size > largest_nm and float(without @ without) > _CLEARLY**2 * float(left @ left)


def _aligned(
    motion: Motion,
    profile: ProfileData,
    torque: FloatArray,
    masked: NDArray[np.bool_],
    beyond: Beyond | None,
) -> Motion:
    """Return the motion with an integrated angle in step with the baseline."""
    if motion.angle_source != "velocity":
        return motion
    velocity = np.where(motion.valid, motion.velocity_rad_s, 0.0)
    period = float(np.median(np.diff(motion.time_s)))
    moved = turned_motion(motion, motion.angle_rad + 0.5 * period * (velocity - velocity[0]))
    usable = motion.valid & np.isfinite(torque) & ~masked
    if beyond is not None:
        torque = torque - beyond.torque_nm
    left = []
    for candidate in (motion, moved):
        fixed, names, columns = baseline_columns(candidate, profile)
        if "misalignment:cosine" not in names:
            # on less than an output turn it would hide which angle the ripple fits
            turn = candidate.output_angle_rad
            columns = np.column_stack([columns, np.cos(turn), np.sin(turn)])
        design, response = columns[usable], (torque - fixed)[usable]
        if len(response) <= design.shape[1]:
            return motion
        solution = np.linalg.lstsq(design, response, rcond=None)[0]
        left.append(float(np.sum((response - design @ solution) ** 2)))
    best = moved if left[1] < left[0] else motion
    orders = () if beyond is None else beyond.orders
    return without_drift(best, profile, torque, usable, orders)


def with_simulated(record: Record, fitted_nm: FloatArray) -> Record:
    """Return the record with the torque that a fit simulates, for causes that act on all of it.

    Parameters
    ----------
    record : Record
        Record.
    fitted_nm : ndarray, shape (n_samples,)
        Fitted torque without what is fixed, N m.

    Returns
    -------
    Record
    """
    simulated = np.where(record.valid, record.fixed_nm + fitted_nm, np.nan)
    return replace(record, motion=replace(record.motion, simulated_nm=simulated))


def mask_samples(record: Record, masked: NDArray[np.bool_]) -> Record:
    """Return the record without the marked samples.

    Parameters
    ----------
    record : Record
        Record.
    masked : ndarray of bool, shape (n_samples,)
        Samples to be left out.

    Returns
    -------
    Record
    """
    valid = record.valid & ~masked
    return replace(
        record,
        valid=valid,
        columns=np.where(valid[:, None], record.columns, 0.0),
        nuisance=np.where(valid[:, None], record.nuisance, 0.0),
        jitter=np.where(valid[:, None], record.jitter, 0.0),
    )
