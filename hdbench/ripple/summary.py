"""Result of a ripple run, made of its joint fit: components, spectrum, noise of a filter block."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.estimation.harmonics import harmonic_at
from hdbench.estimation.regression import ordinary_fit
from hdbench.estimation.spectrum import amplitude_spectrum, find_peaks
from hdbench.estimation.stretches import SteadyStretch, longest_steady
from hdbench.estimation.trend import Trend
from hdbench.jointfit import JointFit, MotionRecord
from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray
from hdbench.results import DataFlag, RippleResult
from hdbench.results.dynamic import (
    EvaluatedTime,
    OutputOrder,
    RippleBlocks,
    RippleOrder,
    SlowTerms,
    SteadySpectrum,
    Suppression,
    TorqueRms,
    VelocityRange,
)

# blocks over which the wander of the amplitudes is judged, and cycles of the lowest order in each
_BLOCKS = 8
_CYCLES_PER_BLOCK = 5.0
# an amplitude left in the filtered torque is seen above so many of its standard uncertainties
_SEEN_SIGMA = 2.0
# an order is called off its nominal value outside this interval: once in a thousand by chance
_OFF_CONFIDENCE = 0.999
# a steadier stretch is preferred as long as it holds this many motor turns: order resolution 0.05
_SPECTRUM_TURNS = 20.0
_STEADIER = (0.1, 0.3, 1.0)


@dataclass(frozen=True, slots=True)
class Regression:
    """The joint fit of a ripple run and what was decided on the way to it."""

    # columns: slow terms, orders, output orders where fitted, lines
    fit: JointFit
    trend: Trend
    orders: tuple[float, ...]
    # factor by which an integrated angle was corrected; None where it was not
    angle_scale: Quantity | None
    # orders as measured in the angle of the record, before any correction
    estimates: tuple[Quantity | None, ...]
    n_slow: int
    # 1, or 1 and 2; empty where the output travelled less than a turn
    output_orders: tuple[float, ...]


def summarise(regression: Regression, filtered_nm: FloatArray, filter_name: str) -> RippleResult:
    """Return the result of a ripple run from its joint fit."""
    fit, orders, trend = regression.fit, regression.orders, regression.trend
    record, used = fit.record, fit.record.used
    velocity, time = record.motion.velocity_rad_s[used], record.motion.time_s[used]
    wander, origin = _wander(regression)
    first = regression.n_slow + 2 * len(orders)
    output = [fit.component(first + 2 * i) for i in range(len(regression.output_orders))]
    by_order = [OutputOrder(amplitude_nm=x.amplitude, phase_rad=x.phase) for x in output]
    filtered, ripple = filtered_nm[used], _components(regression)
    noise, rms = fit.found.fit.noise, fit.found.fit.rms
    noise_std = rms if noise is None else noise.innovation_std
    return RippleResult(
        ripple=ripple,
        motor_velocity_rad_s=VelocityRange(
            mean=float(velocity.mean()),
            std=float(velocity.std()),
            min=float(velocity.min()),
            max=float(velocity.max()),
        ),
        torque_rms_nm=TorqueRms(
            measured=_rms(record.torque_nm[used]), filtered=_rms(filtered[np.isfinite(filtered)])
        ),
        suppression_db=tuple(
            Suppression(
                order=x.order, suppression_db=x.suppression_db, is_bound=x.suppression_is_bound
            )
            for x in ripple
        ),
        spectrum=_spectrum(regression),
        output_order_1=by_order[0] if by_order else None,
        output_order_2=by_order[1] if len(by_order) > 1 else None,
        trend=SlowTerms(
            degree=trend.degree,
            direction_offset=trend.direction,
            output_sinusoid=trend.output,
            rule="offset by direction, sinusoid of the output angle, polynomial in time; each "
            "kept while the BIC of the residual with autoregressive noise falls",
        ),
        noise_std_nm=noise_std,
        evaluated=EvaluatedTime(from_s=float(time[0]), to_s=float(time[-1])),
        angle_source=record.motion.angle_source,
        angle_scale=regression.angle_scale,
        filter=RippleBlocks(
            name=filter_name,
            orders=orders,
            measurement_noise=noise_std**2,
            measurement_noise_origin="innovation variance of the residual, (N m)^2",
            process_noise=wander,
            process_noise_origin=origin,
        ),
        notes=_notes(regression),
        **fit.shared_keys(),
    )


def _rms(torque_nm: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(torque_nm))))


def _components(regression: Regression) -> tuple[RippleOrder, ...]:
    entries = []
    for i, order in enumerate(regression.orders):
        column = regression.n_slow + 2 * i
        here = harmonic_at(regression.fit.found.fit, column)
        left = harmonic_at(regression.fit.filtered, column).amplitude
        bound = not left.value > _SEEN_SIGMA * left.std
        after = left.std if bound else left.value
        both = not here.small and after > 0.0
        entries.append(
            RippleOrder(
                order=order,
                order_estimate=regression.estimates[i],
                amplitude_nm=regression.fit.record.scaled(here.amplitude),
                phase_rad=here.phase,
                small_amplitude=here.small,
                suppression_db=20.0 * math.log10(here.amplitude.value / after) if both else None,
                suppression_is_bound=bound,
            )
        )
    return tuple(entries)


def _notes(regression: Regression) -> tuple[DataFlag, ...]:
    record = regression.fit.record
    notes, n_samples = [], regression.fit.found.fit.n_samples
    velocity = record.motion.velocity_rad_s[record.used]
    if record.motion.angle_source == "velocity" and velocity.min() < 0.0 < velocity.max():
        step = float(np.median(np.diff(record.motion.time_s)))
        lag = 0.5 * float(np.max(np.abs(velocity))) * step
        detail = (
            "the angle was integrated sample by sample: half a sample is up to "
            f"{lag:.3g} rad of motor angle, with opposite signs in the two directions"
        )
        notes.append(DataFlag("integrated-angle", n_samples, detail))
    if regression.angle_scale is not None:
        detail = f"the integrated angle was scaled by {regression.angle_scale.value:.5g}"
        notes.append(DataFlag("velocity-scale", n_samples, detail))
        return tuple(notes)
    for order, estimate in zip(regression.orders, regression.estimates, strict=True):
        if estimate is None:
            continue
        low, high = estimate.interval(_OFF_CONFIDENCE)
        if not low <= order <= high:
            detail = f"order {order:g} measures {estimate.value:.5g} in this record"
            notes.append(DataFlag("order-off-nominal", n_samples, detail))
    return tuple(notes)


def _spectrum(regression: Regression) -> SteadySpectrum | None:
    record, found = regression.fit.record, regression.fit.found
    stretch = _steadiest(record)
    if stretch is None:
        return None
    part = slice(stretch.start, stretch.stop)
    slow = found.design[part, : regression.n_slow] @ found.fit.coefficients[: regression.n_slow]
    spectrum = amplitude_spectrum(
        record.torque_nm[part] - slow, float(np.median(np.diff(record.motion.time_s[part])))
    )
    # the names of the report: the ripple's place as a multiple of the motor velocity
    names = {f"{order:g}x": order for order in regression.orders}
    return SteadySpectrum(
        from_s=stretch.from_s,
        to_s=stretch.to_s,
        motor_velocity_rad_s=stretch.velocity_rad_s,
        resolution_hz=spectrum.resolution_hz,
        peaks=find_peaks(spectrum, stretch.velocity_rad_s, names),
    )


def _steadiest(record: MotionRecord) -> SteadyStretch | None:
    motion, gaps = record.motion, record.starts.copy()
    # no spectrum reaches across a gap; the first sample follows none
    gaps[0] = False
    found = None
    for share in _STEADIER:
        found = longest_steady(
            motion.time_s,
            motion.velocity_rad_s,
            record.used & ~gaps,
            tolerance=share * record.profile.ripple.steady_tolerance,
        )
        if found is not None and _motor_turns(record, found) >= _SPECTRUM_TURNS:
            break
    return found


def _motor_turns(record: MotionRecord, stretch: SteadyStretch) -> float:
    angle = record.motion.angle_rad
    return abs(float(angle[stretch.stop - 1] - angle[stretch.start])) / (2.0 * math.pi)


def _wander(regression: Regression) -> tuple[float, str]:
    """Return the process noise per sample that the change of the amplitudes along the run shows.

    Blocks of L samples each give amplitudes with variance v; for a random walk with variance q
    per sample the difference of neighbouring block means has variance 2 q L / 3 + 2 v.
    """
    record, design = regression.fit.record, regression.fit.found.design
    fit = regression.fit.found.fit
    index = np.flatnonzero(record.used)
    first = regression.n_slow
    columns = design[:, first : first + 2 * len(regression.orders)]
    rest = np.delete(np.arange(design.shape[1]), np.arange(first, first + columns.shape[1]))
    response = record.response_nm - design[:, rest] @ fit.coefficients[rest]
    travelled = np.abs(np.diff(record.motion.angle_rad[index])).sum() / (2.0 * math.pi)
    blocks = min(_BLOCKS, int(travelled * min(regression.orders) / _CYCLES_PER_BLOCK))
    whole = math.sqrt(max(float(np.mean(np.diag(fit.covariance)[first : first + 2])), 0.0))
    floor = max(whole**2 / fit.n_samples, np.finfo(float).tiny)
    least = "smallest that the record could show: its amplitudes do not wander measurably"
    if blocks < 3:
        return floor, "smallest that the record could show: too short to see amplitudes wander"
    fits = []
    for part in np.array_split(index, blocks):
        try:
            fits.append(ordinary_fit(columns[part], response[part]))
        except ValueError:
            return floor, least
    values = np.array([f.coefficients for f in fits])
    spread = float(np.mean(np.diff(values, axis=0) ** 2))
    own = float(np.mean([np.diag(f.covariance) for f in fits]))
    walk = (spread - 2.0 * own) * 1.5 / (len(index) / blocks)
    if not walk > floor:
        return floor, least
    return walk, f"wander of the amplitudes over {blocks} blocks of the record"
