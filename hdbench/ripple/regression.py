"""The joint regression of a free-motion run."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hdbench.estimation.harmonics import TURNS_FOR_ORDER_2, harmonic_columns
from hdbench.estimation.refine import OrderEstimate, refine_order
from hdbench.estimation.regression import LinearFit, coloured_fit
from hdbench.estimation.search import LineFit, fit_with_lines
from hdbench.estimation.trend import SlowMotion, Trend, choose_trend, trend_columns
from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray
from hdbench.ripple.record import Record

__all__ = ["Regression", "regress"]

# a scale error of the velocity is believed when the measured order is off by so many sigma
_SCALE_SIGMA = 3.0
# output turns from which output order 1 is told from a drift
_TURNS_FOR_ORDER_1 = 1.0
# share of the nominal order; a tacho that is off by more is a fault, not a scale
_LARGEST_SCALE_ERROR = 0.01


@dataclass(frozen=True, slots=True)
class Regression:
    """The joint fit and what was decided on the way to it.

    Parameters
    ----------
    found : LineFit
        Fit with lines; columns: slow terms, orders, output orders where fitted, lines.
    filtered : LinearFit
        The same columns fitted to the filtered torque.
    filtered_nm : ndarray, shape (n,)
        Filtered torque, N m.
    trend : Trend
        Slow terms.
    orders : tuple of float
        Nominal orders.
    angle_scale : Quantity or None
        Factor by which the integrated angle was corrected; None where it was not.
    estimates : tuple of Quantity or None
        Orders as measured in the angle of the record, before any correction.
    n_slow : int
        Number of slow columns.
    output_orders : tuple of float
        Output orders fitted, 1 or 1 and 2; empty where the output travelled less than a turn.
    """

    found: LineFit
    filtered: LinearFit
    filtered_nm: FloatArray
    trend: Trend
    orders: tuple[float, ...]
    angle_scale: Quantity | None
    estimates: tuple[Quantity | None, ...]
    n_slow: int
    output_orders: tuple[float, ...]


def regress(record: Record, orders: tuple[float, ...], filtered: FloatArray) -> Regression:
    """Fit slow terms, orders, output orders and lines jointly."""
    response = record.torque_nm - record.expected_nm
    trend, slow = _slow_terms(record, orders, response)
    angle_scale = None
    if record.motion.angle_source == "velocity":
        angle_scale = _angle_scale(record, orders, slow, response)
        record = _corrected(record, angle_scale)
    motion, used, starts = record.motion, record.used, record.starts
    output_orders = _output_orders(record)
    output = _output_columns(record)
    design = np.hstack([slow, harmonic_columns(motion.angle_rad, orders), output])
    found = fit_with_lines(
        design,
        response,
        used,
        motor_angle_rad=motion.angle_rad,
        time_s=motion.time_s,
        orders=orders + tuple(order / motion.gear_ratio for order in output_orders),
        starts=starts,
    )
    measured = [_measure(record, i, orders, found, slow.shape[1]) for i in range(len(orders))]
    factor = 1.0 if angle_scale is None else angle_scale.value
    return Regression(
        found=found,
        filtered=coloured_fit(found.design, filtered - record.expected_nm, used, starts=starts),
        filtered_nm=filtered,
        trend=trend,
        orders=orders,
        angle_scale=angle_scale,
        estimates=tuple(None if m is None else _times(m.order, factor) for m in measured),
        n_slow=slow.shape[1],
        output_orders=output_orders,
    )


def _times(quantity: Quantity, factor: float) -> Quantity:
    return Quantity(quantity.value * factor, quantity.std * factor, quantity.dof)


def _slow_terms(
    record: Record, orders: tuple[float, ...], response: FloatArray
) -> tuple[Trend, FloatArray]:
    motion = record.motion
    others = np.hstack([harmonic_columns(motion.angle_rad, orders), _output_columns(record)])
    slow = SlowMotion(motion.time_s, motion.velocity_rad_s, motion.output_angle_rad)
    trend = choose_trend(others, response, slow, record.used, starts=record.starts)
    return trend, trend_columns(trend, slow, record.used)


def _output_orders(record: Record) -> tuple[float, ...]:
    """Return the output orders that the travel of the output can tell from a drift."""
    turns = float(np.ptp(record.motion.output_angle_rad[record.used])) / (2.0 * math.pi)
    if turns < _TURNS_FOR_ORDER_1:
        return ()
    return (1.0,) if turns < TURNS_FOR_ORDER_2 else (1.0, 2.0)


def _output_columns(record: Record) -> FloatArray:
    return harmonic_columns(record.motion.output_angle_rad, _output_orders(record))


def _corrected(record: Record, angle_scale: Quantity | None) -> Record:
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
    record: Record, orders: tuple[float, ...], slow: FloatArray, response: FloatArray
) -> Quantity | None:
    """Return the scale error of an integrated angle that the strongest order shows, if any."""
    angle = record.motion.angle_rad
    others = np.hstack([slow, _output_columns(record)])
    design = np.hstack([others, harmonic_columns(angle, orders)])
    fit = coloured_fit(design, response, record.used, starts=record.starts)
    best: tuple[float, OrderEstimate] | None = None
    for i, order in enumerate(orders):
        k = others.shape[1] + 2 * i
        rest = np.delete(design, [k, k + 1], axis=1)
        estimate = refine_order(order, fit, rest, response, angle, starts=record.starts)
        if estimate is not None and (best is None or estimate.gain > best[1].gain):
            best = (order, estimate)
    if best is None:
        return None
    scale = _times(best[1].order, 1.0 / best[0])
    off = abs(scale.value - 1.0)
    return scale if _SCALE_SIGMA * scale.std < off < _LARGEST_SCALE_ERROR else None


def _measure(
    record: Record, index: int, orders: tuple[float, ...], found: LineFit, n_slow: int
) -> OrderEstimate | None:
    """Return the measured order of one component beside everything else in the fit."""
    k = n_slow + 2 * index
    rest = np.delete(found.design, [k, k + 1], axis=1)
    response = record.torque_nm - record.expected_nm
    return refine_order(
        orders[index], found.fit, rest, response, record.motion.angle_rad, starts=record.starts
    )
