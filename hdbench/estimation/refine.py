"""The order of a component as a number to be measured."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.estimation.harmonics import harmonic_columns
from hdbench.estimation.noise import NoiseModel
from hdbench.estimation.regression import LinearFit
from hdbench.estimation.whitening import whiten
from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray

__all__ = ["OrderEstimate", "refine_order"]

# the order is looked for within this share of the nominal one, or 1.5 resolutions if that is more
_RANGE_SHARE = 0.01
_RANGE_RESOLUTIONS = 1.5
# and never beyond so many resolutions: a longer search would meet the neighbours of the line
_MOST_RESOLUTIONS = 20.0
# steps per resolution of the search: fine enough for the last steps to converge
_STEPS_PER_RESOLUTION = 5.0
# gain of likelihood, in units of the noise, below which an order is not estimated: 5 sigma
_LEAST_GAIN = 25.0


@dataclass(frozen=True, slots=True)
class _Projected:
    """A whitened record with everything else projected out, to be fitted by one order."""

    angle_rad: FloatArray
    used: NDArray[np.bool_]
    noise: NoiseModel
    starts: NDArray[np.bool_] | None
    basis: FloatArray
    target: FloatArray

    @property
    def middle_rad(self) -> float:
        """Middle of the angle's range, about which an order's slope is nearly orthogonal, rad."""
        angle = self.angle_rad[self.used]
        return 0.5 * float(np.max(angle) + np.min(angle))

    def solve(
        self, order: float, about: FloatArray | None = None
    ) -> tuple[FloatArray, float, FloatArray]:
        """Return coefficients at `order`, the gain of likelihood, and the inverse normal matrix.

        With `about`, cosine and sine coefficients, the slope over the order is a third column.
        """
        columns = harmonic_columns(self.angle_rad, [order])
        if about is not None:
            slope = about[1] * columns[:, 0] - about[0] * columns[:, 1]
            columns = np.column_stack([columns, (self.angle_rad - self.middle_rad) * slope])
        table = whiten(columns, self.noise, self.used, starts=self.starts)[self.used]
        table = table - self.basis @ (self.basis.T @ table)
        inverse = np.asarray(np.linalg.pinv(table.T @ table, hermitian=True), dtype=np.float64)
        solution = inverse @ (table.T @ self.target)
        return solution, float(solution @ (table.T @ self.target)), inverse


@dataclass(frozen=True, slots=True)
class OrderEstimate:
    """An order measured from the record.

    Parameters
    ----------
    order : Quantity
        Cycles per motor turn.
    gain : float
        Sum of squares of the whitened residual that the component explains, dimensionless.
    """

    order: Quantity
    gain: float


def refine_order(
    nominal: float,
    fit: LinearFit,
    others: FloatArray,
    response: FloatArray,
    angle_rad: FloatArray,
    *,
    starts: NDArray[np.bool_] | None = None,
) -> OrderEstimate | None:
    """Measure the order of a component near a nominal one.

    Notes
    -----
    Nonlinear least squares on whitened data by variable projection: the gain of likelihood is
    searched on a grid of a fifth of the resolution ``1 / turns``, then Gauss-Newton steps with
    the column ``angle * (b cos - a sin)``. The uncertainty is that of this column's coefficient
    in the joint fit, with the dof of `fit`.

    References
    ----------
    .. [1] G. H. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413, doi:10.1137/0710036.
    """
    if fit.noise is None:
        return None
    turns = float(np.ptp(angle_rad[fit.used])) / (2.0 * math.pi)
    if not turns > 2.0 / nominal:
        return None
    table = whiten(np.column_stack([others, response]), fit.noise, fit.used, starts=starts)
    basis, _ = np.linalg.qr(table[fit.used, :-1])
    target = table[fit.used, -1]
    target = target - basis @ (basis.T @ target)
    record = _Projected(angle_rad, fit.used, fit.noise, starts, basis, target)
    resolution = 1.0 / turns
    half = min(
        max(_RANGE_SHARE * nominal, _RANGE_RESOLUTIONS * resolution), _MOST_RESOLUTIONS * resolution
    )
    order = _coarse(record, nominal, half, resolution)
    if order is None:
        return None
    order, gain, unit_variance = _refined(record, order, resolution)
    free = max(1.0, len(target) - others.shape[1] - 3)
    variance = max(float(target @ target) - gain, 0.0) / free
    if not (abs(order - nominal) <= half and unit_variance > 0.0):
        return None
    std = math.sqrt(variance * unit_variance)
    return OrderEstimate(Quantity(order, std, fit.dof), gain / variance if variance > 0.0 else gain)


def _coarse(record: _Projected, nominal: float, half: float, resolution: float) -> float | None:
    """Return the best order of a grid, or None where it is weak or lies at the end."""
    n_steps = math.ceil(half / resolution * _STEPS_PER_RESOLUTION)
    grid = nominal + np.linspace(-half, half, 2 * n_steps + 1)
    gains = [record.solve(float(order))[1] for order in grid]
    best = int(np.argmax(gains))
    if best in (0, len(grid) - 1) or not gains[best] > _LEAST_GAIN:
        return None
    return float(grid[best])


def _refined(record: _Projected, order: float, resolution: float) -> tuple[float, float, float]:
    """Return the order after Gauss-Newton steps, its gain, and the variance per unit noise."""
    pair, gain, _ = record.solve(order)
    unit_variance = 0.0
    # from a fifth of the resolution the steps converge quadratically: four reach rounding
    for _ in range(4):
        solution, _, inverse = record.solve(order, pair)
        unit_variance = float(inverse[2, 2])
        order += float(np.clip(solution[2], -resolution, resolution))
        pair, gain, _ = record.solve(order)
    return order, gain, unit_variance
