"""Mean of gains with the position as random effect: restricted likelihood, and plain mean."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray
from hdbench.results.calibration import MixedModel

# the ratio of variances is sought as share of the sum, up to this: beyond it the position is all
_MAX_SHARE = 1.0 - 1e-9
# each zoom narrows the share to a twentieth: 1e-9 after seven
_GRID, _ZOOMS = 41, 7
# last digit of a gain, share of it
_ROUNDING = 1e-15


def mixed_fit(
    gains: Sequence[float], positions: Sequence[int], fixed: Sequence[Sequence[str]]
) -> MixedModel | None:
    """Fit the mixed model.

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
    design, places = _fixed_columns(fixed), np.equal.outer(positions, positions).astype(float)
    free = len(y) - int(np.linalg.matrix_rank(design))
    if len(set(positions)) < 2 or free < 2 or np.linalg.matrix_rank(design) < design.shape[1]:
        return None
    if not float(np.ptp(y)) > 0.0:
        exact = Quantity(float(y[0]), 0.0, float(free))
        return MixedModel(
            gain_nm_per_v=exact, between_positions_nm_per_v=0.0, repeatability_nm_per_v=0.0
        )
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
    return MixedModel(
        gain_nm_per_v=_quantity(found, weights, (total, places, information)),
        between_positions_nm_per_v=float(np.sqrt(variances[0])),
        repeatability_nm_per_v=float(np.sqrt(variances[1])),
    )


def _fixed_columns(fixed: Sequence[Sequence[str]]) -> FloatArray:
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


def plain_mean(
    gains: Sequence[float], positions: Sequence[int], fixed: Sequence[Sequence[str]]
) -> Quantity:
    """Return the plain mean of gains with a random effect of the position.

    Notes
    -----
    With P the share of the experiments at each position, mean squares B of the positions after
    the fixed effects and W within positions, and ``E B = s_e^2 + q s_pos^2`` (Henderson's third
    method): ``u^2 = sum P^2 s_pos^2 + s_e^2 / N = B / N + (sum P^2 / q - 1 / N) (B - W)``, the
    second part where B is the larger one. Degrees of freedom by Satterthwaite. Where each
    position holds the same experiments this is ``B / N`` with one degree less than positions.
    What the fixed effects leave in the mean (see `mixed_fit`) is added as it stands.

    References
    ----------
    .. [1] S. R. Searle, G. Casella, C. E. McCulloch, Variance Components, Wiley 1992, section 5.4.
    .. [2] F. E. Satterthwaite, Biometrics Bull. 2 (1946) 110, doi:10.2307/3002019.
    """
    y = np.asarray(gains, dtype=float)
    places = np.equal.outer(positions, np.unique(positions)).astype(float)
    share = float(((places.sum(axis=0) / len(y)) ** 2).sum())
    design = _fixed_columns(fixed)
    smooth, whole = _projector(design), _projector(np.column_stack([design, places]))
    n_between = round(float(np.trace(whole - smooth)))
    n_within = len(y) - round(float(np.trace(whole)))
    if n_between < 1:
        # directions or ranges cannot be told from positions: the scatter of the position means
        means = places.T @ y / places.sum(axis=0)
        std = float(means.std(ddof=1)) * math.sqrt(share)
        return Quantity(float(y.mean()), std, float(len(means) - 1))
    between = float(y @ (whole - smooth) @ y) / n_between
    within = float(y @ y - y @ whole @ y) / n_within if n_within else 0.0
    # a mean square cannot be negative; rounding of equal gains can make one
    between, within = max(0.0, between), max(0.0, within)
    own = float(np.trace(places.T @ (np.eye(len(y)) - smooth) @ places)) / n_between
    variance, dof = _variance_of_mean(
        (between, n_between), (within, n_within), share / own, 1.0 / len(y)
    )
    fit = mixed_fit(gains, positions, fixed)
    off = 0.0 if fit is None else float(y.mean()) - fit.gain_nm_per_v.value
    return Quantity(float(y.mean()), math.hypot(math.sqrt(variance), off), dof)


def _projector(columns: FloatArray) -> FloatArray:
    return np.asarray(columns @ np.linalg.pinv(columns))


def _variance_of_mean(
    between: tuple[float, int], within: tuple[float, int], first: float, even: float
) -> tuple[float, float]:
    """Return variance of the mean and its degrees of freedom."""
    (b, n_b), (w, n_w) = between, within
    if not n_w:
        return first * b, float(n_b)
    if not b > w:
        return even * b, float(n_b)
    second = even - first
    variance = first * b + second * w
    dof = variance**2 / ((first * b) ** 2 / n_b + (second * w) ** 2 / n_w)
    return variance, max(1.0, dof)
