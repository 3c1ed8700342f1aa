"""Restricted maximum likelihood for gains that are not the same number everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray

__all__ = ["MixedFit", "fixed_columns", "mixed_fit"]

# the ratio of variances is sought as share of the sum, up to this: beyond it the position is all
_MAX_SHARE = 1.0 - 1e-9
# each zoom narrows the share to a twentieth: 1e-9 after seven
_GRID, _ZOOMS = 41, 7
# last digit of a gain, share of it
_ROUNDING = 1e-15


@dataclass(frozen=True, slots=True)
class MixedFit:
    """Gains with fixed effects of direction and range and a random effect of the position.

    Parameters
    ----------
    gain : Quantity
        Gain averaged over directions and ranges with equal weight, N m/V.
    between_std, repeatability : float
        Standard deviations between and within positions, N m/V.
    """

    gain: Quantity
    between_std: float
    repeatability: float


def mixed_fit(
    gains: Sequence[float], positions: Sequence[int], fixed: Sequence[Sequence[str]]
) -> MixedFit | None:
    """Fit the mixed model.

    Parameters
    ----------
    gains : sequence of float
        One per experiment, N m/V.
    positions : sequence of int
        Number of the position of each experiment.
    fixed : sequence of sequence of str
        Levels of the fixed effects of each experiment, such as direction and range.

    Returns
    -------
    MixedFit or None
        None where there are too few experiments for the effects, or fewer than two positions.

    Notes
    -----
    ``G = X b + Z p + e`` with p and e normal; the ratio of their variances maximises the
    restricted likelihood. Degrees of freedom by Satterthwaite's approximation with the expected
    information of the two variances.

    References
    ----------
    .. [1] H. D. Patterson, R. Thompson, Biometrika 58 (1971) 545, doi:10.1093/biomet/58.3.545.
    .. [2] F. G. Giesbrecht, J. C. Burns, Biometrics 41 (1985) 477, doi:10.2307/2530872.
    """
    y = np.asarray(gains, dtype=float)
    design, places = fixed_columns(fixed), np.equal.outer(positions, positions).astype(float)
    free = len(y) - int(np.linalg.matrix_rank(design))
    if len(set(positions)) < 2 or free < 2 or np.linalg.matrix_rank(design) < design.shape[1]:
        return None
    if not float(np.ptp(y)) > 0.0:
        exact = Quantity(float(y[0]), 0.0, float(free))
        return MixedFit(exact, 0.0, 0.0)
    share = _best_share(y, design, places)
    scale = float(_restricted(np.array([share]), y, design, places)[0][0])
    # gains that the effects explain to the last digit leave rounding, not zero
    scale = max(scale, (_ROUNDING * float(np.max(np.abs(y)))) ** 2)
    variances = np.array([share * scale, (1.0 - share) * scale])
    total = variances[0] * places + variances[1] * np.eye(len(y))
    information = _information(total, design, places)
    inverse = np.linalg.inv(total)
    bread = np.linalg.inv(design.T @ inverse @ design)
    weights = inverse @ design @ bread[:, 0]
    found = float(weights @ y)
    return MixedFit(
        _quantity(found, weights, (total, places, information)),
        float(np.sqrt(variances[0])),
        float(np.sqrt(variances[1])),
    )


def fixed_columns(fixed: Sequence[Sequence[str]]) -> FloatArray:
    """Return the mean and, per effect, level less last level: the mean is that of all levels."""
    columns = [np.ones(len(fixed))]
    for effect in zip(*fixed, strict=True):
        levels = sorted(set(effect))
        last = np.array([level == levels[-1] for level in effect], dtype=float)
        columns += [
            np.array([word == level for word in effect], dtype=float) - last
            for level in levels[:-1]
        ]
    return np.column_stack(columns)


def _restricted(
    shares: FloatArray, y: FloatArray, design: FloatArray, places: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return total variance and minus twice the restricted log likelihood at each share."""
    part = shares[:, None, None]
    total = part * places + (1.0 - part) * np.eye(len(y))
    inverse = np.linalg.inv(total)
    inner = design.T @ inverse @ design
    right = (inverse @ y) @ design
    left = y - np.linalg.solve(inner, right[..., None])[..., 0] @ design.T
    free = len(y) - design.shape[1]
    scale = np.einsum("gi,gij,gj->g", left, inverse, left) / free
    logs = np.linalg.slogdet(total)[1] + np.linalg.slogdet(inner)[1]
    return scale, free * np.log(np.maximum(scale, np.finfo(float).tiny)) + logs


def _best_share(y: FloatArray, design: FloatArray, places: FloatArray) -> float:
    low, high, best = 0.0, _MAX_SHARE, 0.0
    for _ in range(_ZOOMS):
        grid = np.linspace(low, high, _GRID)
        place = int(np.argmin(_restricted(grid, y, design, places)[1]))
        best = float(grid[place])
        low, high = float(grid[max(0, place - 1)]), float(grid[min(_GRID - 1, place + 1)])
    return best


def _information(total: FloatArray, design: FloatArray, places: FloatArray) -> FloatArray:
    """Return the expected information of the two variances."""
    inverse = np.linalg.inv(total)
    inner = np.linalg.inv(design.T @ inverse @ design)
    project = inverse - inverse @ design @ inner @ design.T @ inverse
    parts = [project @ places, project]
    return np.array([[0.5 * float(np.trace(a @ b)) for b in parts] for a in parts])


def _quantity(
    value: float, weights: FloatArray, parts: tuple[FloatArray, FloatArray, FloatArray]
) -> Quantity:
    """Return a weighted mean with std and dof."""
    total, places, information = parts
    variance = float(weights @ total @ weights)
    slope = np.array([float(weights @ places @ weights), float(weights @ weights)])
    spread = float(slope @ np.linalg.pinv(information) @ slope)
    dof = max(1.0, 2.0 * variance**2 / spread) if spread > 0.0 else 1.0
    return Quantity(value, float(np.sqrt(variance)), dof)
