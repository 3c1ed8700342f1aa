"""Curves without a name: what is left over speed, load, time or angle when no cause fits."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.fit.terms import Term
from hdbench.diagnosis.measured.record import Record
from hdbench.diagnosis.naming.products import by_direction, square_of_speed, turns_both_ways
from hdbench.model import Cause, Motion, Parameter
from hdbench.records.trace import FloatArray

__all__ = [
    "CURVE_PREFIX",
    "DIRECTION",
    "bin_edges",
    "curve_causes",
    "equal_bins",
    "is_law",
]

CURVE_PREFIX = "curve over "
_SMOOTH = " (smooth)"
DIRECTION = "motor order (by direction)"
_SQUARE = "velocity (square)"
_TURN_OVER_RAD_S = (0.1, 10.0)
_DIRECTION_ORDERS = (0.9, 6.1)
# distinct speeds that make a curve over speed
_MOVING = 3
_VELOCITY_BINS = 16
_TORQUE_BINS = 10
_TIME_BLOCKS = 24
_OUTPUT_ORDERS = 12
# widths of a local bump over the output angle, turns, and its places
_BUMP_WIDTHS = (1.0 / 64.0, 1.0 / 16.0)
_BUMP_PLACES = 32
# smallest number of samples that a bin may hold
_MIN_BIN = 200


def equal_bins(values: FloatArray, valid: NDArray[np.bool_], count: int) -> list[NDArray[np.bool_]]:
    """Return masks of bins that hold equal shares of the valid samples.

    Parameters
    ----------
    values : ndarray, shape (n,)
        What is binned: speed, rad/s, or time, s.
    valid : ndarray of bool, shape (n,)
        Samples that count.
    count : int
        Number of bins, at least 2.

    Returns
    -------
    list of ndarray of bool, shape (n,)
        Bins of 200 samples at least; none where the values are too few or too much alike.
    """
    edges = bin_edges(values[valid], count)
    if len(edges) < 3:
        return []
    where = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    masks = [valid & (where == k) for k in range(len(edges) - 1)]
    return [m for m in masks if int(m.sum()) >= _MIN_BIN]


def bin_edges(values: FloatArray, count: int) -> FloatArray:
    """Return the edges of bins with equal shares of finite values.

    Parameters
    ----------
    values : ndarray, shape (n,)
        What is binned.
    count : int
        Number of bins, at least 1.

    Returns
    -------
    ndarray, shape (n_edges,)
        Each edge once; empty where no value is finite.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return np.zeros(0)
    return np.unique(np.quantile(finite, np.linspace(0.0, 1.0, count + 1)))


def _bare(name: str, count: int, columns: Callable[..., FloatArray], *shape: Parameter) -> Cause:
    linear = tuple(Parameter(f"part{k}_nm", "N m", -np.inf, np.inf, "height") for k in range(count))
    return Cause(
        CURVE_PREFIX + name, "a table", shape, linear, "", "", "", (), "", "", columns, False
    )


def _hats(name: str, axis: Callable[[Motion], FloatArray], knots: FloatArray) -> Cause | None:
    """Return a cause that is piecewise linear over an axis; None for fewer than three knots."""
    if len(knots) < 3:
        return None

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        del shape
        values = np.clip(axis(motion), knots[0], knots[-1])
        right = np.clip(np.searchsorted(knots, values, side="right"), 1, len(knots) - 1)
        part = (values - knots[right - 1]) / (knots[right] - knots[right - 1])
        table = np.zeros((len(values), len(knots)))
        rows = np.arange(len(values))
        table[rows, right - 1] = 1.0 - part
        table[rows, right] = part
        return np.asarray(table[:, 1:])

    return _bare(name, len(knots) - 1, columns)


def _powers(name: str, axis: Callable[[Motion], FloatArray], scale: float) -> Cause:
    """Return a cause with four powers of an axis, odd ones with and without the magnitude."""

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        del shape
        x = axis(motion) / scale
        return np.column_stack([x, x * np.abs(x), x**3, x * x])

    return _bare(name + _SMOOTH, 4, columns)


def _apart(edges: FloatArray) -> FloatArray:
    """Return edges at least a hundredth of their range apart."""
    kept: list[float] = []
    for edge in edges:
        if not kept or edge - kept[-1] > 0.01 * (edges[-1] - edges[0]):
            kept.append(float(edge))
    return np.array(kept)


def _bumps(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    away = motion.output_angle_rad - shape["position_rad"]
    away = away - 2.0 * np.pi * np.round(away / (2.0 * np.pi))
    width = 2.0 * np.pi * shape["width_turns"]
    return np.asarray(np.exp(-0.5 * (away / width) ** 2)[:, None])


def _orders(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    del shape
    phase = np.multiply.outer(motion.output_angle_rad, np.arange(2, _OUTPUT_ORDERS + 1))
    return np.hstack([np.cos(phase), np.sin(phase)])


def _largest(values: FloatArray, valid: NDArray[np.bool_]) -> float:
    return max(float(np.abs(values[valid]).max(initial=0.0)), 1e-12)


def curve_causes(record: Record) -> tuple[Cause, ...]:
    """Return the curves that a record can show.

    Parameters
    ----------
    record : Record
        Record; its quantiles place the knots.

    Returns
    -------
    tuple of Cause
        Piecewise linear over motor speed, known torque and time, four powers of speed and torque,
        the square of the speed alone, motor orders that change sign with the direction, output
        orders 2 to 12, and a local bump at any output angle; without names of the catalogue.
    """
    motion, valid = record.motion, record.valid
    wanted = [
        _hats(
            "velocity",
            lambda m: m.velocity_rad_s,
            _apart(bin_edges(motion.velocity_rad_s[valid], _VELOCITY_BINS)),
        ),
        _hats("time", lambda m: m.time_s, _apart(bin_edges(motion.time_s[valid], _TIME_BLOCKS))),
    ]
    speed = _largest(motion.velocity_rad_s, valid)
    if len(_apart(bin_edges(motion.velocity_rad_s[valid], _VELOCITY_BINS))) > _MOVING:
        wanted.append(_powers("velocity", lambda m: m.velocity_rad_s, speed))
        wanted.append(_bare(_SQUARE, 1, square_of_speed))
    if turns_both_ways(record):
        order = Parameter("order", "1", *_DIRECTION_ORDERS, "cycles per motor turn")
        over = Parameter("turn_over_rad_s", "rad/s", *_TURN_OVER_RAD_S, "speed of the reversal")
        wanted.append(_bare(DIRECTION, 2, by_direction, order, over))
    if motion.load_torque_nm is not None:
        knots = _apart(bin_edges(motion.applied_nm[valid], _TORQUE_BINS))
        wanted.append(_hats("torque", lambda m: m.applied_nm, knots))
        wanted.append(_powers("torque", lambda m: m.applied_nm, _largest(motion.applied_nm, valid)))
    if float(np.ptp(motion.output_angle_rad[valid])) >= 2.0 * np.pi:
        wanted.append(_bare("output angle", 2 * _OUTPUT_ORDERS - 2, _orders))
        place = Parameter("position_rad", "rad", 0.0, 2.0 * np.pi, "output angle of the bump")
        width = Parameter("width_turns", "1", *_BUMP_WIDTHS, "its width")
        wanted.append(_bare("output place", 1, _bumps, place, width))
    return tuple(cause for cause in wanted if cause is not None)


def is_law(term: Term) -> bool:
    """Return whether a term without a name is a law with as few parameters as a name has.

    Parameters
    ----------
    term : Term
        Term.

    Returns
    -------
    bool
        A table gathers what several causes do; the square of the speed and a ripple by direction
        do not.
    """
    return term.cause.name in (CURVE_PREFIX + _SQUARE, CURVE_PREFIX + DIRECTION)
