"""Intervals of the consistency: the spread of gains over their mean."""

from __future__ import annotations

import math

import numpy as np

from hdbench.calibration.gains.positions import by_position
from hdbench.results.calibration import ExperimentLine

__all__ = ["consistency_interval", "shared_dof", "vangel_interval"]


def shared_dof(lines: tuple[ExperimentLine, ...]) -> float:
    """Return the effective dof of the spread of gains that share positions.

    Notes
    -----
    With sums of squares B between and W within positions, of b and w dof:
    ``(B + W)^2 / (B^2 / b + W^2 / w)``.

    References
    ----------
    .. [1] F. E. Satterthwaite, Biometrics Bull. 2 (1946) 110, doi:10.2307/3002019.
    """
    groups = by_position(lines)
    gains = [np.array([x.gain_nm_per_v for x in group]) for group in groups]
    total = float(np.concatenate(gains).mean())
    between = math.fsum(len(g) * (float(g.mean()) - total) ** 2 for g in gains)
    within = math.fsum(float(((g - g.mean()) ** 2).sum()) for g in gains)
    n_between, n_within = len(groups) - 1, len(lines) - len(groups)
    loss = (between**2 / n_between if n_between else 0.0) + (
        within**2 / n_within if n_within else 0.0
    )
    # no spread at all: every gain the same, dof as for independent gains
    return (between + within) ** 2 / loss if loss > 0.0 else float(len(lines) - 1)


def consistency_interval(
    consistency: float, dof: float, confidence: float = 0.95
) -> tuple[float, float]:
    """Return the interval of a relative standard deviation by chi-square.

    Parameters
    ----------
    consistency : float
        Standard deviation over mean, at least 0.
    dof : float
        Degrees of freedom of that standard deviation, above 0.
    confidence : float
        Coverage probability, in (0, 1).

    Returns
    -------
    tuple of float
        Lower and upper end.

    Notes
    -----
    ``C sqrt(dof / chi2(1 - tail, dof))`` to ``C sqrt(dof / chi2(tail, dof))``: the mean counts as
    known, which changes the ends by shares of C^2.
    """
    from scipy.special import chdtri

    tail = (1.0 - confidence) / 2.0
    # chdtri takes the probability above the quantile
    high, low = float(chdtri(dof, tail)), float(chdtri(dof, 1.0 - tail))
    return consistency * math.sqrt(dof / high), consistency * math.sqrt(dof / low)


def vangel_interval(
    consistency: float, dof: float, confidence: float = 0.95
) -> tuple[float, float | None]:
    """Return the interval of a coefficient of variation of normal values.

    Notes
    -----
    With n = dof + 1 and u the chi-square quantile of dof degrees of freedom (upper for the
    lower end): ``C / sqrt(((u + 2) / n - 1) C^2 + u / (n - 1))``.

    References
    ----------
    .. [1] M. G. Vangel, Am. Stat. 50 (1996) 21, doi:10.1080/00031305.1996.10473537.
    """
    from scipy.special import chdtri

    n = dof + 1.0
    tail = (1.0 - confidence) / 2.0
    ends: list[float | None] = []
    # chdtri takes the probability above the quantile
    for u in (float(chdtri(dof, tail)), float(chdtri(dof, 1.0 - tail))):
        square = ((u + 2.0) / n - 1.0) * consistency**2 + u / dof
        ends.append(consistency / math.sqrt(square) if square > 0.0 else None)
    low, high = ends
    return (0.0 if low is None else low), high
