"""The joint regression of a free-motion run."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hdbench.estimation.harmonics import harmonic_columns
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
# share of the nominal order; a tacho that is off by more is a fault, not a scale
_LARGEST_SCALE_ERROR = 0.01


@dataclass(frozen=True, slots=True)
class Regression:
    """The joint fit and what was decided on the way to it.

    Parameters
    ----------
    found : LineFit
        Fit with lines; columns: slow terms, orders, output order 1 where fitted, lines.
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
    output : bool
        Whether output order 1 was fitted.
    """

    found: LineFit
    filtered: LinearFit
    filtered_nm: FloatArray
    trend: Trend
    orders: tuple[float, ...]
    angle_scale: Quantity | None
    estimates: tuple[Quantity | None, ...]
    n_slow: int
    output: bool


def regress(record: Record, orders: tuple[float, ...], filtered: FloatArray) -> Regression:
    """Fit slow terms, orders, output order 1 and lines jointly.

    Parameters
    ----------
    record : Record
        The trace made ready.
    orders : tuple of float
        Nominal motor orders.
    filtered : ndarray, shape (n,)
        Filtered torque, N m.

    Returns
    -------
    Regression

    Raises
    ------
    ValueError
        If samples are too few or columns cannot be told apart.
    """
    response = record.torque_nm - record.expected_nm
    trend, slow = _slow_terms(record, orders, response)
    angle_scale = None
    if record.motion.angle_source == "velocity":
        angle_scale = _angle_scale(record, orders, slow, response)
        record = _corrected(record, angle_scale)
    motion, used, starts = record.motion, record.used, record.starts
    output = _output_columns(record)
    design = np.hstack([slow, harmonic_columns(motion.angle_rad, orders), output])
    found = fit_with_lines(
        design,
        response,
        used,
        motor_angle_rad=motion.angle_rad,
        time_s=motion.time_s,
        orders=orders + ((1.0 / motion.gear_ratio,) if output.shape[1] else ()),
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
        output=bool(output.shape[1]),
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


def _output_columns(record: Record) -> FloatArray:
    """Return output order 1 where the output spans a turn, else no column."""
    angle = record.motion.output_angle_rad
    if float(np.ptp(angle[record.used])) >= 2.0 * math.pi:
        return harmonic_columns(angle, [1.0])
    return np.zeros((len(angle), 0))


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
