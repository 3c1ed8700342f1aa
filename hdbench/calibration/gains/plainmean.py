"""Uncertainty of the plain mean of gains where positions hold different experiments."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hdbench.calibration.gains.mixed import fixed_columns, mixed_fit
from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray

__all__ = ["plain_mean"]


def plain_mean(
    gains: Sequence[float], positions: Sequence[int], fixed: Sequence[Sequence[str]]
) -> Quantity:
    """Return the plain mean of gains with a random effect of the position.

    Parameters
    ----------
    gains : sequence of float
        One per experiment, N m/V.
    positions : sequence of int
        Number of the position of each experiment, from 0; at least two.
    fixed : sequence of sequence of str
        Levels of the fixed effects of each experiment, such as direction and range.

    Returns
    -------
    Quantity

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
    design = fixed_columns(fixed)
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
    variance, dof = _combined((between, n_between), (within, n_within), share / own, 1.0 / len(y))
    fit = mixed_fit(gains, positions, fixed)
    off = 0.0 if fit is None else float(y.mean()) - fit.gain.value
    return Quantity(float(y.mean()), math.hypot(math.sqrt(variance), off), dof)


def _projector(columns: FloatArray) -> FloatArray:
    return np.asarray(columns @ np.linalg.pinv(columns))


def _combined(
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
