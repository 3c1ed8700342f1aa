"""The once-per-output-turn torque of a constant-velocity run."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import DataError
from hdbench.estimation.channel import DataFlag, data_flags, stretch_starts, torque_channel
from hdbench.estimation.harmonics import harmonic_at, harmonic_columns, scaled
from hdbench.estimation.regression import LinearFit, coloured_fit
from hdbench.estimation.search import LineFit, fit_with_lines
from hdbench.estimation.stretches import SteadyStretch, steady_runs
from hdbench.filter import FilterModel, filter_trace
from hdbench.misalignment.result import MisalignmentResult
from hdbench.model.motion import Motion, motion_from_trace
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import Quantity
from hdbench.records.scale import TorqueScale
from hdbench.records.trace import FloatArray, Trace

__all__ = ["evaluate_misalignment"]

# ripple orders fitted jointly, contract section 6
_RIPPLE_ORDERS = (2.0, 4.0)
# below one turn offset and sinusoid are hardly told apart; from two on a slow drift is told too
_LEAST_TURNS = 1.0
_GOOD_TURNS = 2.0
# from here on output orders 1 and 2 and an offset are told apart without loss
_TURNS_FOR_ORDER_2 = 1.5
# turns are counted to 2 %: the steady stretch of a plan of whole turns misses its first samples
_TURN_MARGIN = 0.02


@dataclass(frozen=True, slots=True)
class _Record:
    """One trace made ready for the regression."""

    trace: Trace
    motion: Motion
    torque_nm: FloatArray
    expected_nm: FloatArray
    stretches: tuple[SteadyStretch, ...]
    turns: tuple[float, ...]
    used: NDArray[np.bool_]
    starts: NDArray[np.bool_]


def evaluate_misalignment(
    trace: Trace, profile: ProfileData, *, scale: TorqueScale, filter_model: FilterModel
) -> MisalignmentResult:
    """Evaluate the misalignment torque of a constant-velocity run, one or both directions.

    Parameters
    ----------
    trace : Trace
        Torque, velocity and, where there is one, an angle.
    profile : ProfileData
        Gear ratio, load inertia, settling time and tolerance.
    scale : TorqueScale
        Gain with its uncertainty.
    filter_model : FilterModel
        Filter whose effect on the output-order component is measured.

    Returns
    -------
    MisalignmentResult

    Raises
    ------
    DataError
        If a channel is missing, nothing is steady, or no stretch spans one output turn.

    Notes
    -----
    Over all steady samples ``torque - J/N acceleration = offset of the stretch + a cos(output) +
    b sin(output) + output order 2 + orders 2 and 4 + lines found + coloured noise``; generalised
    least squares, see `coloured_fit`. The uncertainty of amplitudes is that of the regression and
    the relative one of the gain, see `combine`. The acceleration is without lag.

    References
    ----------
    .. [1] H. D. Taghirad, CIM-TR-97-06, McGill University, 1997, section 5.
    """
    record = _prepare(trace, profile, scale)
    motion = record.motion
    design = _design(record)
    try:
        found = fit_with_lines(
            design,
            record.torque_nm - record.expected_nm,
            record.used,
            motor_angle_rad=motion.angle_rad,
            time_s=motion.time_s,
            orders=(1.0 / motion.gear_ratio, 2.0 / motion.gear_ratio, *_RIPPLE_ORDERS),
            starts=record.starts,
        )
    except ValueError as error:
        raise _cannot_fit(trace, f"the regression has no solution: {error}") from error
    filtered = filter_trace(
        trace.with_columns(torque_nm=record.torque_nm),
        filter_model,
        velocity_gain_rad_s_per_v=profile.tacho.gain_rad_s_per_v,
        encoder_counts_per_turn=profile.encoder.counts_per_turn,
    ).torque_filtered_nm
    after = coloured_fit(
        found.design, filtered - record.expected_nm, record.used, starts=record.starts
    )
    return _result(record, found, after, profile, scale, filter_model.name)


def _cannot_fit(trace: Trace, what: str) -> DataError:
    return DataError(
        what,
        where=f"{trace.source}: motor velocity",
        fix="record a run at constant velocity over at least two output turns",
    )


def _prepare(trace: Trace, profile: ProfileData, scale: TorqueScale) -> _Record:
    torque = torque_channel(trace, scale)
    motion = motion_from_trace(trace, profile)
    runs = steady_runs(
        motion.time_s,
        motion.velocity_rad_s,
        settle_s=profile.misalignment.settle_s,
        tolerance=profile.ripple.steady_tolerance,
    )
    if not runs:
        raise _cannot_fit(
            trace,
            "no stretch is steady: found none within "
            f"{100.0 * profile.ripple.steady_tolerance:g} % of its median velocity for longer "
            f"than {profile.misalignment.settle_s:g} s",
        )
    turns = [_turns(motion, run) for run in runs]
    if not max(turns) >= _LEAST_TURNS - _TURN_MARGIN:
        raise _cannot_fit(
            trace,
            f"the longest steady stretch spans {max(turns):.3f} output turns "
            f"({max(turns) * motion.gear_ratio:.1f} motor turns); needed: at least 1 output turn "
            f"({motion.gear_ratio:g} motor turns), better 2",
        )
    # a short stretch has an offset of its own and still tells of the ripple, but below a
    # quarter turn its offset takes what it knows of the output order
    kept = [i for i, n in enumerate(turns) if n >= 0.25]
    stretches = tuple(runs[i] for i in kept)
    starts = stretch_starts(motion.time_s)
    used = np.zeros(len(torque), dtype=bool)
    for run in stretches:
        used[run.start : run.stop] = True
        starts[run.start] = True
    used &= motion.valid & np.isfinite(torque)
    expected = profile.drive.load_inertia_kg_m2 / motion.gear_ratio * motion.acceleration_rad_s2
    counted = tuple(turns[i] for i in kept)
    return _Record(trace, motion, torque, expected, stretches, counted, used, starts)


def _turns(motion: Motion, run: SteadyStretch) -> float:
    angle = motion.output_angle_rad[run.start : run.stop]
    return float(np.nanmax(angle) - np.nanmin(angle)) / (2.0 * math.pi)


def _design(record: _Record) -> FloatArray:
    """Return offset per stretch, output order 1, orders 2 and 4, and output order 2, in this order.

    Output order 2 (a shaft at an angle) lies so close to order 1 that no search would tell it from
    a drift; it is fitted wherever the record is long enough to hold both.
    """
    offsets = np.zeros((len(record.torque_nm), len(record.stretches)))
    for i, run in enumerate(record.stretches):
        offsets[run.start : run.stop, i] = 1.0
    columns = [
        offsets,
        harmonic_columns(record.motion.output_angle_rad, [1.0]),
        harmonic_columns(record.motion.angle_rad, _RIPPLE_ORDERS),
    ]
    if max(record.turns) >= _TURNS_FOR_ORDER_2:
        columns.append(harmonic_columns(record.motion.output_angle_rad, [2.0]))
    return np.hstack(columns)


def _notes(record: _Record, small: bool) -> tuple[DataFlag, ...]:
    notes = []
    longest = max(record.turns)
    if longest < _GOOD_TURNS - _TURN_MARGIN:
        detail = (
            f"{longest:.2f} output turns: a slow drift and the misalignment are hardly told apart"
        )
        notes.append(DataFlag("few-output-turns", int(record.used.sum()), detail))
    if small:
        detail = "amplitude below three standard uncertainties: biased upwards, phase hardly known"
        notes.append(DataFlag("small-amplitude", int(record.used.sum()), detail))
    return tuple(notes)


def _result(
    record: _Record,
    found: LineFit,
    after_fit: LinearFit,
    profile: ProfileData,
    scale: TorqueScale,
    filter_name: str,
) -> MisalignmentResult:
    relative, dof = scale.relative_std, scale.gain_nm_per_v.dof
    fit, n_offsets = found.fit, len(record.stretches)
    here = harmonic_at(fit, n_offsets)
    before = scaled(here.amplitude, relative, dof)
    after = scaled(harmonic_at(after_fit, n_offsets).amplitude, relative, dof)
    ripple = tuple(
        (order, scaled(harmonic_at(fit, n_offsets + 2 + 2 * i).amplitude, relative, dof))
        for i, order in enumerate(_RIPPLE_ORDERS)
    )
    second = None
    if max(record.turns) >= _TURNS_FOR_ORDER_2:
        at = n_offsets + 2 + 2 * len(_RIPPLE_ORDERS)
        second = scaled(harmonic_at(fit, at).amplitude, relative, dof)
    lengths = [run.stop - run.start for run in record.stretches]
    speeds = [abs(run.velocity_rad_s) for run in record.stretches]
    return MisalignmentResult(
        amplitude_nm=before,
        peak_to_peak_nm=_doubled(before),
        phase_rad=here.phase,
        before=_doubled(before),
        after=_doubled(after),
        small_amplitude=here.small,
        output_turns=math.fsum(record.turns),
        mean_torque_nm=float(np.mean(record.torque_nm[record.used])),
        motor_velocity_rad_s=float(np.average(speeds, weights=lengths)),
        stretches=record.stretches,
        offsets_nm=tuple(scaled(fit.quantity(i), relative, dof) for i in range(n_offsets)),
        ripple=ripple,
        output_order_2=second,
        lines=tuple(line.scaled(relative, dof) for line in found.lines),
        residual_rms_nm=fit.rms,
        noise=None if fit.noise is None else fit.noise.to_dict(),
        scale=scale,
        filter_name=filter_name,
        process_noise=profile.filter.misalignment_process_noise,
        measurement_noise=profile.filter.measurement_noise,
        gear_ratio=record.motion.gear_ratio,
        flags=data_flags(record.trace, record.torque_nm, profile),
        notes=_notes(record, here.small),
        n_samples=fit.n_samples,
    )


def _doubled(amplitude: Quantity) -> Quantity:
    return Quantity(2.0 * amplitude.value, 2.0 * amplitude.std, amplitude.dof)
