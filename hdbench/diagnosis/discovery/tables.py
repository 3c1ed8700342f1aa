"""Tables: dictionaries over an axis, or over two, for effects that no name covers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.discovery.record import Record
from hdbench.model import Cause, Motion, Parameter
from hdbench.records.trace import FloatArray

# prefix of the name of a table, which no cause of the catalogue has
TABLE = "table:"
# knots over an axis, and over each of two; of these a smooth function needs fewer
_KNOTS = 13
_KNOTS_OF_TWO = 5
_FEWER = (2, 3, 5)
# a knot that fewer samples see than this share of the most seen one is left out
_SELDOM = 1e-3
# samples from which that is judged
_THIN = 5000
# knots over the output angle, which may hold local faults
_TURN_KNOTS = 24
# an axis that varies by less than this share of its size is none, nor fewer radians of the output
_VARIES = 0.05
_TURN_RAD = 3.0


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis of a table.

    Parameters
    ----------
    domain : str
        Domain of the contract.
    unit : str
        Unit.
    values : ndarray, shape (n_samples,)
        Value at every sample.
    knots : ndarray
        Knots, increasing.
    period : float
        Period of an angle; 0 for a line.
    """

    domain: str
    unit: str
    values: FloatArray
    knots: FloatArray
    period: float = 0.0

    def hats(self, count: int) -> FloatArray:
        """Return smooth functions over about `count` of the knots."""
        return self._hats(self.values, self.picked(count))

    def origin(self, count: int) -> int:
        """Return which of about `count` knots is the nearest to zero."""
        return int(np.argmin(np.abs(self.picked(count))))

    def levels(self, count: int) -> list[FloatArray]:
        """Return the values at the knots of functions over fewer of them, each (n_knots, n)."""
        return [self._hats(self.picked(count), self.picked(fewer)) for fewer in _FEWER]

    def picked(self, count: int) -> FloatArray:
        """Return about `count` of the knots."""
        if self.period:
            return self.knots[:: max(1, len(self.knots) // count)]
        pick = np.unique(np.linspace(0, len(self.knots) - 1, count).round().astype(int))
        return np.asarray(self.knots[pick])

    def _hats(self, values: FloatArray, knots: FloatArray) -> FloatArray:
        """Return smooth functions that are one at a knot and zero at all others, at some values."""
        from scipy.interpolate import CubicSpline

        eye = np.eye(len(knots))
        if self.period:
            values, knots = np.mod(values, self.period), np.append(knots, knots[0] + self.period)
            curves = CubicSpline(knots, np.vstack([eye, eye[:1]]), bc_type="periodic")
        else:
            curves = CubicSpline(knots, eye, bc_type="natural")
        known = np.isfinite(values)
        inside = np.clip(np.where(known, values, knots[0]), knots[0], knots[-1])
        return np.where(known[:, None], curves(inside), np.nan)


@dataclass(frozen=True, slots=True)
class Table(Cause):
    """A table without a name, as a cause.

    Parameters
    ----------
    subsets : tuple of ndarray, shape (n_knots, k)
        Simpler functions that it holds, any of which is as likely as the whole: those over fewer
        knots, and one knot alone.
    """

    subsets: tuple[FloatArray, ...] = ()


def subsets_of(cause: Cause) -> tuple[FloatArray, ...]:
    """Return the simpler functions that a table holds; none for any other cause."""
    return cause.subsets if isinstance(cause, Table) else ()


def _knots(values: FloatArray, valid: NDArray[np.bool_], count: int) -> FloatArray:
    """Return knots with as many samples between each two, and with even distances: half each."""
    held = values[valid]
    by_rank = np.quantile(held, np.linspace(0.0, 1.0, count))
    even = np.linspace(held.min(), held.max(), count)
    return np.unique(0.5 * (by_rank + even))


def axes_of(record: Record) -> tuple[Axis, ...]:
    """Return the axes over which this record can hold a table."""
    motion, valid = record.motion, record.valid
    time = motion.time_s - motion.time_s[0]
    # records of a stack have no time in common
    axes = [] if record.records else [Axis("time", "s", time, _knots(time, valid, _KNOTS))]

    def line(domain: str, unit: str, values: FloatArray | None) -> None:
        if values is None:
            return
        filled = np.where(valid & np.isfinite(values), values, 0.0)
        held = filled[valid]
        size = float(np.sqrt(np.mean(held**2)))
        if size > 0.0 and float(np.std(held)) > _VARIES * size:
            axes.append(Axis(domain, unit, filled, _knots(filled, valid, _KNOTS)))

    line("velocity", "rad/s", motion.velocity_rad_s)
    load = motion.load_smooth_nm if motion.load_smooth_nm is not None else motion.load_torque_nm
    line("load", "N m", load)
    if float(np.nanmax(np.abs(motion.acceleration_rad_s2[valid]))) > (
        10.0 * motion.acceleration_noise_rad_s2
    ):
        line("acceleration", "rad/s^2", motion.acceleration_rad_s2)
    turn = np.where(valid, motion.output_angle_rad, 0.0)
    if float(np.ptp(turn[valid])) > _TURN_RAD:
        knots = np.linspace(0.0, 2.0 * np.pi, _TURN_KNOTS, endpoint=False)
        axes.append(Axis("output-order", "rad", turn, knots, 2.0 * np.pi))
    return tuple(axes)


def table_causes(record: Record) -> tuple[Cause, ...]:
    """Return the tables over every axis and every pair of axes, as causes without a name."""
    axes = axes_of(record)
    causes = [_table((axis,), record, len(axis.knots)) for axis in axes]
    for i, one in enumerate(axes):
        causes += [_table((one, other), record, _KNOTS_OF_TWO) for other in axes[i + 1 :]]
    return tuple(causes)


def is_table(cause: Cause) -> bool:
    """Return whether a cause is a table without a name."""
    return cause.name.startswith(TABLE)


def _table(axes: tuple[Axis, ...], record: Record, count: int) -> Cause:
    """Return a table as a cause; its columns are formed anew whenever they are asked for."""
    thin = slice(None, None, max(1, len(record) // _THIN))
    square = np.sum(_products(axes, count, thin)[record.valid[thin]] ** 2, axis=0)
    # the zero of the baseline holds what all knots have in common; what is slower than the noise of
    # an acceleration is cut from it, so that it is the knot at rest that goes
    kept = np.setdiff1d(np.flatnonzero(square > _SELDOM * square.max()), _origin(axes, count))

    def columns(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
        del motion, shape
        return _products(axes, count, slice(None))[:, kept]

    domains = [axis.domain for axis in axes]
    knots = tuple(
        Parameter(f"knot_{k}_nm", "N m", -1e6, 1e6, "torque at one knot") for k in range(len(kept))
    )
    name = TABLE + "*".join(domains)
    levels = axes[0].levels(count)
    if len(axes) == 2:
        both = zip(levels, axes[1].levels(count), strict=True)
        levels = [np.asarray(np.kron(one, other), dtype=float) for one, other in both]
    origins = [_origin(axes, fewer) for fewer in _FEWER]
    pairs = zip(levels, origins, strict=True)
    subsets = [np.delete(level[kept], origin, axis=1) for level, origin in pairs]
    if len(axes) == 1:
        subsets += list(np.eye(len(kept))[:, :, None])
    held = (name, "a table", (), knots, domains[0], "", "", (), "", "", columns, False)
    return Table(*held, subsets=tuple(subsets))


def _origin(axes: tuple[Axis, ...], count: int) -> int:
    """Return the place of the product that is one where all axes are nearest to zero."""
    sizes = [len(axis.picked(count)) for axis in axes]
    return int(np.ravel_multi_index([axis.origin(count) for axis in axes], sizes))


def _products(axes: tuple[Axis, ...], count: int, rows: slice) -> FloatArray:
    """Return products of the hat functions of all axes at some samples."""
    parts = [replace(axis, values=axis.values[rows]).hats(count) for axis in axes]
    if len(parts) == 1:
        return parts[0]
    return np.asarray((parts[0][:, :, None] * parts[1][:, None, :]).reshape(len(parts[0]), -1))
