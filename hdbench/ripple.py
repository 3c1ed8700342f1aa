"""Torque ripple of a free-motion run: samples, joint regression, result."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hdbench.errors import DataError, UsageError
from hdbench.estimation.harmonics import TURNS_FOR_ORDER_2, harmonic_at, harmonic_columns
from hdbench.estimation.regression import LinearFit, coloured_fit, ordinary_fit
from hdbench.estimation.search import OrderEstimate, refine_order
from hdbench.estimation.spectrum import amplitude_spectrum, find_peaks
from hdbench.estimation.stretches import SteadyStretch, longest_steady
from hdbench.estimation.trend import SlowMotion, Trend, choose_trend, trend_columns
from hdbench.filter import FilterModel
from hdbench.jointfit import JointFit, MotionRecord, filtered_torque, joint_fit, read_motion
from hdbench.model import baseline_orders
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import Quantity, TorqueScale
from hdbench.records.trace import FloatArray, Trace
from hdbench.results import DataFlag, RippleResult, dynamic

# below two cycles an offset and a sinusoid are hardly told apart
_LEAST_CYCLES = 2.0
# a scale error of the velocity is believed when the measured order is off by so many sigma
_SCALE_SIGMA = 3.0
# output turns from which output order 1 is told from a drift
_TURNS_FOR_ORDER_1 = 1.0
# share of the nominal order; a tacho that is off by more is a fault, not a scale
_LARGEST_SCALE_ERROR = 0.01


@dataclass(frozen=True, slots=True)
class Stretch:
    """Which samples are evaluated; all by default."""

    # only samples whose motor velocity exceeds this in magnitude, rad/s
    velocity_above_rad_s: float | None = None
    # only samples within these times, s
    from_s: float | None = None
    to_s: float | None = None

    def __post_init__(self) -> None:
        for name in ("velocity_above_rad_s", "from_s", "to_s"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise UsageError(
                    f"{name} is {value!r}; needed: a finite number",
                    where=name,
                    fix="name a number, or leave it out",
                )

    def describe(self) -> str:
        """Return the stretch in words."""
        words = []
        if self.velocity_above_rad_s is not None:
            words.append(f"motor faster than {self.velocity_above_rad_s:g} rad/s")
        if self.from_s is not None:
            words.append(f"from {self.from_s:g} s")
        if self.to_s is not None:
            words.append(f"to {self.to_s:g} s")
        return ", ".join(words) or "all samples"


def evaluate_ripple(
    trace: Trace,
    profile: ProfileData,
    *,
    scale: TorqueScale,
    filter_model: FilterModel,
    stretch: Stretch | None = None,
) -> RippleResult:
    """Evaluate the torque ripple of a run.

    Its orders are those of the model's baseline: 2, 4 and further ones of the profile, seen from
    a turning flexspline times 1 + 1/N.

    Parameters
    ----------
    trace : Trace
        Torque, velocity and, where there is one, an angle.
    profile : ProfileData
        Gear ratio, load inertia, tolerance of a steady stretch.
    scale : TorqueScale
        Gain with its uncertainty.
    filter_model : FilterModel
        Filter whose suppression is measured.
    stretch : Stretch, optional
        Which samples; all without it.

    Returns
    -------
    RippleResult

    Raises
    ------
    DataError
        If a channel is missing, the motor turns less than two cycles of the lowest order, or too
        few samples are left to tell the orders apart.

    Notes
    -----
    ``torque - J/N acceleration = slow terms + sum_o (a_o cos(o angle) + b_o sin(o angle)) +
    output order 1 (where the output spans a turn) and 2 (1.5 turns) + lines found + coloured
    noise`` by generalised least squares over all samples chosen. Slow terms are chosen by BIC,
    see `choose_trend`. Suppression is the ratio of the amplitudes that the same columns have in
    measured and in filtered torque. Where the angle was integrated from a velocity, a scale error
    of it of up to 1 % is found from the measured order of the strongest component, and the angle
    is corrected.

    References
    ----------
    .. [1] H. D. Taghirad, CIM-TR-97-06, McGill University, 1997, section 4.
    """
    orders = baseline_orders(profile)
    stretch = stretch or Stretch()
    record = _within(read_motion(trace, profile, scale), stretch)
    _check_travel(record, orders, stretch)
    filtered = filtered_torque(record, filter_model)
    try:
        regression = _regress(record, orders, filtered)
    except ValueError as error:
        raise DataError(
            f"orders {', '.join(f'{o:g}' for o in orders)} cannot be fitted: {error}; "
            f"{int(record.used.sum())} samples were chosen",
            where=f"{trace.source}: {stretch.describe()}",
            fix="choose a longer stretch, or one at higher velocity",
        ) from error
    return summarise(regression, filtered, filter_model.name)


def _within(record: MotionRecord, stretch: Stretch) -> MotionRecord:
    """Return the record with the samples of a stretch alone."""
    motion, used = record.motion, record.used.copy()
    if stretch.velocity_above_rad_s is not None:
        used &= np.abs(motion.velocity_rad_s) > stretch.velocity_above_rad_s
    if stretch.from_s is not None:
        used &= motion.time_s >= stretch.from_s
    if stretch.to_s is not None:
        used &= motion.time_s <= stretch.to_s
    if not used.any():
        raise DataError(
            "no sample is left to evaluate",
            where=f"{record.trace.source}: {stretch.describe()}",
            fix="choose a wider range of time or a lower velocity",
        )
    return replace(record, used=used)


def _check_travel(record: MotionRecord, orders: tuple[float, ...], stretch: Stretch) -> None:
    """Raise where the motor turns less than two cycles of the lowest order."""
    cycles = float(np.ptp(record.motion.angle_rad[record.used])) / (2.0 * math.pi) * min(orders)
    if not cycles >= _LEAST_CYCLES:
        raise DataError(
            f"the motor turns {cycles:.3g} cycles of order {min(orders):g}; needed: at least "
            f"{_LEAST_CYCLES:g}",
            where=f"{record.trace.source}: {stretch.describe()}",
            fix="choose a longer stretch, or record the run with more motor turns",
        )


def _regress(
    record: MotionRecord, orders: tuple[float, ...], filtered_nm: FloatArray
) -> Regression:
    """Fit slow terms, orders, output orders and lines jointly."""
    trend, slow = _slow_terms(record, orders)
    turned, angle_scale = record, None
    if record.motion.angle_source == "velocity":
        angle_scale = _angle_scale(record, orders, slow)
        turned = _corrected(record, angle_scale)
    motion, output_orders = turned.motion, _output_orders(turned)
    design = np.hstack([slow, harmonic_columns(motion.angle_rad, orders), _output_columns(turned)])
    known = orders + tuple(order / motion.gear_ratio for order in output_orders)
    fit = joint_fit(turned, design, known, filtered_nm)
    n_slow, factor = slow.shape[1], 1.0 if angle_scale is None else angle_scale.value
    estimates = []
    for i, order in enumerate(orders):
        measured = _measure(turned, order, n_slow + 2 * i, fit.found.design, fit.found.fit)
        estimates.append(None if measured is None else measured.order.times(factor))
    # travel and spectrum are those of the record as it is
    fit = replace(fit, record=record)
    return Regression(fit, trend, orders, angle_scale, tuple(estimates), n_slow, output_orders)


def _slow_terms(record: MotionRecord, orders: tuple[float, ...]) -> tuple[Trend, FloatArray]:
    motion = record.motion
    others = np.hstack([harmonic_columns(motion.angle_rad, orders), _output_columns(record)])
    slow = SlowMotion(motion.time_s, motion.velocity_rad_s, motion.output_angle_rad)
    trend = choose_trend(others, record.response_nm, slow, record.used, starts=record.starts)
    return trend, trend_columns(trend, slow, record.used)


def _output_orders(record: MotionRecord) -> tuple[float, ...]:
    """Return the output orders that the travel of the output can tell from a drift."""
    turns = float(np.ptp(record.motion.output_angle_rad[record.used])) / (2.0 * math.pi)
    if turns < _TURNS_FOR_ORDER_1:
        return ()
    return (1.0,) if turns < TURNS_FOR_ORDER_2 else (1.0, 2.0)


def _output_columns(record: MotionRecord) -> FloatArray:
    return harmonic_columns(record.motion.output_angle_rad, _output_orders(record))


def _corrected(record: MotionRecord, angle_scale: Quantity | None) -> MotionRecord:
    """Return the record with its integrated angle times the scale."""
    if angle_scale is None:
        return record
    motion = record.motion
    output = motion.output_angle_rad
    if motion.output_source == "motor":
        output = output * angle_scale.value
    angle = motion.angle_rad * angle_scale.value
    return replace(record, motion=replace(motion, angle_rad=angle, output_angle_rad=output))


def _angle_scale(
    record: MotionRecord, orders: tuple[float, ...], slow: FloatArray
) -> Quantity | None:
    """Return the scale error of an integrated angle that the strongest order shows, if any."""
    others = np.hstack([slow, _output_columns(record)])
    design = np.hstack([others, harmonic_columns(record.motion.angle_rad, orders)])
    fit = coloured_fit(design, record.response_nm, record.used, starts=record.starts)
    best: tuple[float, OrderEstimate] | None = None
    for i, order in enumerate(orders):
        estimate = _measure(record, order, others.shape[1] + 2 * i, design, fit)
        if estimate is not None and (best is None or estimate.gain > best[1].gain):
            best = (order, estimate)
    if best is None:
        return None
    scale = best[1].order.times(1.0 / best[0])
    off = abs(scale.value - 1.0)
    return scale if _SCALE_SIGMA * scale.std < off < _LARGEST_SCALE_ERROR else None


def _measure(
    record: MotionRecord, order: float, column: int, design: FloatArray, fit: LinearFit
) -> OrderEstimate | None:
    """Return the measured order of the component at a column beside everything else in the fit."""
    rest = np.delete(design, [column, column + 1], axis=1)
    angle = record.motion.angle_rad
    return refine_order(order, fit, rest, record.response_nm, angle, starts=record.starts)


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
    by_order = [dynamic.OutputOrder(amplitude_nm=x.amplitude, phase_rad=x.phase) for x in output]
    filtered, ripple = filtered_nm[used], _components(regression)
    noise, rms = fit.found.fit.noise, fit.found.fit.rms
    noise_std = rms if noise is None else noise.innovation_std
    return RippleResult(
        ripple=ripple,
        motor_velocity_rad_s=dynamic.VelocityRange(
            mean=float(velocity.mean()),
            std=float(velocity.std()),
            min=float(velocity.min()),
            max=float(velocity.max()),
        ),
        torque_rms_nm=dynamic.TorqueRms(
            measured=_rms(record.torque_nm[used]), filtered=_rms(filtered[np.isfinite(filtered)])
        ),
        suppression_db=tuple(
            dynamic.Suppression(
                order=x.order, suppression_db=x.suppression_db, is_bound=x.suppression_is_bound
            )
            for x in ripple
        ),
        spectrum=_spectrum(regression),
        output_order_1=by_order[0] if by_order else None,
        output_order_2=by_order[1] if len(by_order) > 1 else None,
        trend=dynamic.SlowTerms(
            degree=trend.degree,
            direction_offset=trend.direction,
            output_sinusoid=trend.output,
            rule="offset by direction, sinusoid of the output angle, polynomial in time; each "
            "kept while the BIC of the residual with autoregressive noise falls",
        ),
        noise_std_nm=noise_std,
        evaluated=dynamic.EvaluatedTime(from_s=float(time[0]), to_s=float(time[-1])),
        angle_source=record.motion.angle_source,
        angle_scale=regression.angle_scale,
        filter=dynamic.RippleBlocks(
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


def _components(regression: Regression) -> tuple[dynamic.RippleOrder, ...]:
    entries = []
    for i, order in enumerate(regression.orders):
        column = regression.n_slow + 2 * i
        here = harmonic_at(regression.fit.found.fit, column)
        left = harmonic_at(regression.fit.filtered, column).amplitude
        bound = not left.value > _SEEN_SIGMA * left.std
        after = left.std if bound else left.value
        both = not here.small and after > 0.0
        entries.append(
            dynamic.RippleOrder(
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


def _spectrum(regression: Regression) -> dynamic.SteadySpectrum | None:
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
    return dynamic.SteadySpectrum(
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
