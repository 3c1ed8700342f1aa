"""Misalignment: torque once per output turn of a constant-velocity run, and its filter block."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hdbench.errors import DataError
from hdbench.estimation.harmonics import TURNS_FOR_ORDER_2, harmonic_at, harmonic_columns
from hdbench.estimation.stretches import SteadyStretch, steady_runs
from hdbench.filter import FilterModel
from hdbench.jointfit import JointFit, MotionRecord, filtered_torque, joint_fit, read_motion
from hdbench.model import baseline_orders
from hdbench.model.motion import Motion
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import TorqueScale
from hdbench.records.trace import FloatArray, Trace
from hdbench.results import dynamic
from hdbench.results.parts import DataFlag

# turns are counted to 2 %: the steady stretch of a plan of whole turns misses its first samples
_TURN_MARGIN = 0.02
# below one turn offset and sinusoid are hardly told apart
_LEAST_TURNS = 1.0
# a short stretch has an offset of its own and still tells of the ripple, but below a quarter turn
# its offset takes what it knows of the output order
_LEAST_STRETCH_TURNS = 0.25
# from two turns on a slow drift is told too
_GOOD_TURNS = 2.0


@dataclass(frozen=True, slots=True)
class _Stretches:
    """Steady stretches that enter, in time order, and the output turns of each."""

    runs: tuple[SteadyStretch, ...]
    turns: tuple[float, ...]


def evaluate_misalignment(
    trace: Trace, profile: ProfileData, *, scale: TorqueScale, filter_model: FilterModel
) -> dynamic.MisalignmentResult:
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
    whole = read_motion(trace, profile, scale)
    steady = _steady(whole)
    record = _within(whole, steady)
    ratio, ripple_orders = record.motion.gear_ratio, baseline_orders(profile)
    filtered = filtered_torque(record, filter_model)
    try:
        fit = joint_fit(
            record,
            _columns(record, steady, ripple_orders),
            (1.0 / ratio, 2.0 / ratio, *ripple_orders),
            filtered,
        )
    except ValueError as error:
        raise _cannot_fit(trace, f"the regression has no solution: {error}") from error
    return _result(fit, steady, ripple_orders, filter_model.name)


def _cannot_fit(trace: Trace, what: str) -> DataError:
    return DataError(
        what,
        where=f"{trace.source}: motor velocity",
        fix="record a run at constant velocity over at least two output turns",
    )


def _steady(record: MotionRecord) -> _Stretches:
    """Return the stretches that enter and the output turns of each."""
    motion, profile = record.motion, record.profile
    settle_s, tolerance = profile.misalignment.settle_s, profile.ripple.steady_tolerance
    runs = steady_runs(motion.time_s, motion.velocity_rad_s, settle_s=settle_s, tolerance=tolerance)
    if not runs:
        raise _cannot_fit(
            record.trace,
            f"no stretch is steady: found none within {100.0 * tolerance:g} % of its median "
            f"velocity for longer than {settle_s:g} s",
        )
    turns = [_turns(motion, run) for run in runs]
    if not max(turns) >= _LEAST_TURNS - _TURN_MARGIN:
        raise _cannot_fit(
            record.trace,
            f"the longest steady stretch spans {max(turns):.3f} output turns "
            f"({max(turns) * motion.gear_ratio:.1f} motor turns); needed: at least 1 output turn "
            f"({motion.gear_ratio:g} motor turns), better 2",
        )
    kept = [i for i, n in enumerate(turns) if n >= _LEAST_STRETCH_TURNS]
    return _Stretches(tuple(runs[i] for i in kept), tuple(turns[i] for i in kept))


def _turns(motion: Motion, run: SteadyStretch) -> float:
    angle = motion.output_angle_rad[run.start : run.stop]
    return float(np.nanmax(angle) - np.nanmin(angle)) / (2.0 * math.pi)


def _within(record: MotionRecord, steady: _Stretches) -> MotionRecord:
    """Return the record with the steady samples alone."""
    inside, starts = np.zeros(len(record.used), dtype=bool), record.starts.copy()
    for run in steady.runs:
        inside[run.start : run.stop] = True
        starts[run.start] = True
    return replace(record, used=record.used & inside, starts=starts)


def _columns(
    record: MotionRecord, steady: _Stretches, ripple_orders: tuple[float, ...]
) -> FloatArray:
    """Return offset per stretch, output order 1, ripple orders, and output order 2, in this order.

    Notes
    -----
    Output order 2 (a shaft at an angle) lies so close to order 1 that no search would tell it from
    a drift; it is fitted wherever the record is long enough to hold both.
    """
    offsets = np.zeros((len(record.torque_nm), len(steady.runs)))
    for i, run in enumerate(steady.runs):
        offsets[run.start : run.stop, i] = 1.0
    columns = [
        offsets,
        harmonic_columns(record.motion.output_angle_rad, [1.0]),
        harmonic_columns(record.motion.angle_rad, ripple_orders),
    ]
    if max(steady.turns) >= TURNS_FOR_ORDER_2:
        columns.append(harmonic_columns(record.motion.output_angle_rad, [2.0]))
    return np.hstack(columns)


def _result(
    fit: JointFit, steady: _Stretches, ripple_orders: tuple[float, ...], filter_name: str
) -> dynamic.MisalignmentResult:
    record, profile, n_offsets = fit.record, fit.record.profile, len(steady.runs)
    here = fit.component(n_offsets)
    after = record.scaled(harmonic_at(fit.filtered, n_offsets).amplitude)
    beside = [
        dynamic.MisalignmentOrder(
            order=order, amplitude_nm=fit.component(n_offsets + 2 + 2 * i).amplitude
        )
        for i, order in enumerate(ripple_orders)
    ]
    second = None
    if max(steady.turns) >= TURNS_FOR_ORDER_2:
        column = n_offsets + 2 + 2 * len(ripple_orders)
        second = dynamic.MisalignmentOrder(amplitude_nm=fit.component(column).amplitude)
    turns = math.fsum(steady.turns)
    speeds = [abs(run.velocity_rad_s) for run in steady.runs]
    return dynamic.MisalignmentResult(
        amplitude_nm=here.amplitude,
        peak_to_peak_nm=here.amplitude.times(2.0),
        phase_rad=here.phase,
        small_amplitude=here.small,
        before=dynamic.PeakToPeak(peak_to_peak_nm=here.amplitude.times(2.0)),
        after=dynamic.FilteredPeak(peak_to_peak_nm=after.times(2.0), filter=filter_name),
        output_turns=turns,
        mean_torque_nm=float(np.mean(record.torque_nm[record.used])),
        motor_velocity_rad_s=float(
            np.average(speeds, weights=[run.stop - run.start for run in steady.runs])
        ),
        stretches=tuple(
            dynamic.MisalignmentStretch(
                from_s=run.from_s,
                to_s=run.to_s,
                motor_velocity_rad_s=run.velocity_rad_s,
                offset_nm=record.scaled(fit.found.fit.quantity(i)),
            )
            for i, run in enumerate(steady.runs)
        ),
        ripple=tuple(beside),
        output_order_2=second,
        filter=dynamic.MisalignmentBlock(
            order=1.0 / record.motion.gear_ratio,
            process_noise=profile.filter.misalignment_process_noise,
            measurement_noise=profile.filter.measurement_noise,
            amplitude_nm=here.amplitude,
            phase_rad=here.phase,
            origin=f"amplitude and phase: joint regression over {turns:.2f} output turns; "
            "process noise: profile",
        ),
        notes=_notes(record, max(steady.turns), here.small),
        **fit.shared_keys(),
    )


def _notes(record: MotionRecord, longest: float, small: bool) -> tuple[DataFlag, ...]:
    notes = []
    if longest < _GOOD_TURNS - _TURN_MARGIN:
        detail = (
            f"{longest:.2f} output turns: a slow drift and the misalignment are hardly told apart"
        )
        notes.append(DataFlag("few-output-turns", int(record.used.sum()), detail))
    if small:
        detail = "amplitude below three standard uncertainties: biased upwards, phase hardly known"
        notes.append(DataFlag("small-amplitude", int(record.used.sum()), detail))
    return tuple(notes)
