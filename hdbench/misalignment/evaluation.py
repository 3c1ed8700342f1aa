"""The once-per-output-turn torque of a constant-velocity run."""

from __future__ import annotations

import math

import numpy as np

from hdbench.estimation.channel import DataFlag, data_flags
from hdbench.estimation.harmonics import TURNS_FOR_ORDER_2, harmonic_at, scaled
from hdbench.estimation.regression import LinearFit, coloured_fit
from hdbench.estimation.search import LineFit, fit_with_lines
from hdbench.filter import FilterModel, filter_trace
from hdbench.misalignment.record import (
    TURN_MARGIN,
    Record,
    cannot_fit,
    design_columns,
    prepare,
)
from hdbench.misalignment.result import MisalignmentResult
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import Quantity, TorqueScale
from hdbench.records.trace import Trace

__all__ = ["evaluate_misalignment"]

# from two turns on a slow drift is told too
_GOOD_TURNS = 2.0


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
    record = prepare(trace, profile, scale)
    motion = record.motion
    design = design_columns(record)
    try:
        found = fit_with_lines(
            design,
            record.torque_nm - record.expected_nm,
            record.used,
            motor_angle_rad=motion.angle_rad,
            time_s=motion.time_s,
            orders=(1.0 / motion.gear_ratio, 2.0 / motion.gear_ratio, *record.ripple_orders),
            starts=record.starts,
        )
    except ValueError as error:
        raise cannot_fit(trace, f"the regression has no solution: {error}") from error
    filtered = filter_trace(
        trace.with_columns(torque_nm=record.torque_nm),
        filter_model,
        velocity_gain_rad_s_per_v=profile.tacho.gain_rad_s_per_v,
        encoder_counts_per_turn=profile.encoder.counts_per_turn,
    ).torque_filtered_nm
    after = coloured_fit(
        found.design, filtered - record.expected_nm, record.used, starts=record.starts
    )
    return _result(
        record, found, after, profile=profile, scale=scale, filter_name=filter_model.name
    )


def _notes(record: Record, small: bool) -> tuple[DataFlag, ...]:
    notes = []
    longest = max(record.turns)
    if longest < _GOOD_TURNS - TURN_MARGIN:
        detail = (
            f"{longest:.2f} output turns: a slow drift and the misalignment are hardly told apart"
        )
        notes.append(DataFlag("few-output-turns", int(record.used.sum()), detail))
    if small:
        detail = "amplitude below three standard uncertainties: biased upwards, phase hardly known"
        notes.append(DataFlag("small-amplitude", int(record.used.sum()), detail))
    return tuple(notes)


def _beside(
    record: Record, fit: LinearFit, scale: TorqueScale
) -> tuple[tuple[tuple[float, Quantity], ...], Quantity | None]:
    """Return the ripple orders and output order 2 that were fitted beside the misalignment."""
    first = len(record.stretches) + 2
    sizes = [
        scaled(harmonic_at(fit, column).amplitude, scale.relative_std, scale.gain_nm_per_v.dof)
        for column in range(first, first + 2 * len(record.ripple_orders), 2)
    ]
    ripple = tuple(zip(record.ripple_orders, sizes, strict=True))
    if not max(record.turns) >= TURNS_FOR_ORDER_2:
        return ripple, None
    second = harmonic_at(fit, first + 2 * len(record.ripple_orders)).amplitude
    return ripple, scaled(second, scale.relative_std, scale.gain_nm_per_v.dof)


def _result(
    record: Record,
    found: LineFit,
    after_fit: LinearFit,
    *,
    profile: ProfileData,
    scale: TorqueScale,
    filter_name: str,
) -> MisalignmentResult:
    relative, dof = scale.relative_std, scale.gain_nm_per_v.dof
    fit, n_offsets = found.fit, len(record.stretches)
    here = harmonic_at(fit, n_offsets)
    before = scaled(here.amplitude, relative, dof)
    after = scaled(harmonic_at(after_fit, n_offsets).amplitude, relative, dof)
    ripple, second = _beside(record, fit, scale)
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
