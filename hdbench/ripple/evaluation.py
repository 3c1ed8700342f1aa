"""Torque ripple of a free-motion run: which samples, and the joint regression."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hdbench.errors import DataError, UsageError
from hdbench.estimation.harmonics import TURNS_FOR_ORDER_2, harmonic_columns
from hdbench.estimation.regression import LinearFit, coloured_fit
from hdbench.estimation.search import OrderEstimate, refine_order
from hdbench.estimation.trend import SlowMotion, Trend, choose_trend, trend_columns
from hdbench.filter import FilterModel
from hdbench.jointfit import MotionRecord, filtered_torque, joint_fit, read_motion
from hdbench.model import baseline_orders
from hdbench.profile.schema import ProfileData
from hdbench.records.quantity import Quantity, TorqueScale
from hdbench.records.trace import FloatArray, Trace
from hdbench.results import RippleResult
from hdbench.ripple.summary import Regression, summarise

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
    """Which samples are evaluated; all by default.

    Parameters
    ----------
    velocity_above_rad_s : float or None
        Only samples whose motor velocity exceeds this in magnitude, rad/s.
    from_s, to_s : float or None
        Only samples within these times, s.
    """

    velocity_above_rad_s: float | None = None
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
    orders: tuple[float, ...] | None = None,
    stretch: Stretch | None = None,
) -> RippleResult:
    """Evaluate the torque ripple of a run.

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
    orders : tuple of float, optional
        Motor orders, cycles per motor turn, above 0, all different; without it those of the
        model's baseline: 2, 4 and further ones of the profile, seen from a turning flexspline
        times 1 + 1/N.
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
    UsageError
        If an order is not a finite number above 0.

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
    orders = baseline_orders(profile) if orders is None else orders
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
    if not (orders and all(0.0 < order < math.inf for order in orders)):
        raise UsageError(
            f"orders are {orders}; needed: one or more finite numbers above 0",
            where="orders",
            fix="name the motor orders to be fitted, such as 2 and 4",
        )
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
        estimates.append(None if measured is None else _times(measured.order, factor))
    # travel and spectrum are those of the record as it is
    fit = replace(fit, record=record)
    return Regression(fit, trend, orders, angle_scale, tuple(estimates), n_slow, output_orders)


def _times(quantity: Quantity, factor: float) -> Quantity:
    return Quantity(quantity.value * factor, quantity.std * factor, quantity.dof)


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
    scale = _times(best[1].order, 1.0 / best[0])
    off = abs(scale.value - 1.0)
    return scale if _SCALE_SIGMA * scale.std < off < _LARGEST_SCALE_ERROR else None


def _measure(
    record: MotionRecord, order: float, column: int, design: FloatArray, fit: LinearFit
) -> OrderEstimate | None:
    """Return the measured order of the component at a column beside everything else in the fit."""
    rest = np.delete(design, [column, column + 1], axis=1)
    angle = record.motion.angle_rad
    return refine_order(order, fit, rest, record.response_nm, angle, starts=record.starts)
