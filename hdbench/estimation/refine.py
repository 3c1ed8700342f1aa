"""The order of a component as a number to be measured."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdbench.estimation.harmonics import harmonic_columns
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

    Parameters
    ----------
    nominal : float
        Nominal order, cycles per motor turn, above 0.
    fit : LinearFit
        A coloured fit of the record; its noise model and samples are used.
    others : ndarray, shape (n, k)
        Columns of everything else.
    response : ndarray, shape (n,)
        Response, N m.
    angle_rad : ndarray, shape (n,)
        Motor angle, rad.
    starts : ndarray of bool, shape (n,), optional
        Where a new stretch begins.

    Returns
    -------
    OrderEstimate or None
        None where the component is weaker than five sigma, where the best order lies at the end
        of the search, or where the residual has no noise.

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
    used = fit.used
    turns = float(np.ptp(angle_rad[used])) / (2.0 * math.pi)
    if not turns > 2.0 / nominal:
        return None

    def white(columns: FloatArray) -> FloatArray:
        return whiten(columns, fit.noise, used, starts=starts)[used] if fit.noise else columns

    basis, _ = np.linalg.qr(white(others))
    target = white(response)
    target = target - basis @ (basis.T @ target)

    def solve(order: float, slope: FloatArray | None) -> tuple[FloatArray, float, FloatArray]:
        columns = harmonic_columns(angle_rad, [order])
        if slope is not None:
            extra = slope[1] * columns[:, 0] - slope[0] * columns[:, 1]
            columns = np.column_stack([columns, (angle_rad - middle) * extra])
        table = white(columns)
        table = table - basis @ (basis.T @ table)
        inverse = np.asarray(np.linalg.pinv(table.T @ table, hermitian=True), dtype=np.float64)
        solution = inverse @ (table.T @ target)
        return solution, float(solution @ (table.T @ target)), inverse

    middle = 0.5 * float(np.max(angle_rad[used]) + np.min(angle_rad[used]))
    resolution = 1.0 / turns
    half = min(
        max(_RANGE_SHARE * nominal, _RANGE_RESOLUTIONS * resolution), _MOST_RESOLUTIONS * resolution
    )
    n_steps = math.ceil(half / resolution * _STEPS_PER_RESOLUTION)
    grid = nominal + np.linspace(-half, half, 2 * n_steps + 1)
    gains = [solve(float(order), None)[1] for order in grid]
    best = int(np.argmax(gains))
    if best in (0, len(grid) - 1) or not gains[best] > _LEAST_GAIN:
        return None
    order = float(grid[best])
    slope, _, _ = solve(order, None)
    inverse = np.zeros((3, 3))
    # from a fifth of the resolution the steps converge quadratically: four reach rounding
    for _ in range(4):
        solution, _, inverse = solve(order, slope)
        step = float(np.clip(solution[2], -resolution, resolution))
        order += step
        slope, gain, _ = solve(order, None)
    variance = max(float(target @ target) - gain, 0.0) / max(1.0, len(target) - others.shape[1] - 3)
    if not (abs(order - nominal) <= half and inverse[2, 2] > 0.0):
        return None
    std = math.sqrt(variance * float(inverse[2, 2]))
    return OrderEstimate(Quantity(order, std, fit.dof), gain / variance if variance > 0.0 else gain)
