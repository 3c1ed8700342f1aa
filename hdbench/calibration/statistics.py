"""The mean gain over flexspline positions and the spread of gains, with uncertainties."""

from __future__ import annotations

import math

import numpy as np

from hdbench.calibration.gains.plainmean import plain_mean
from hdbench.calibration.lines import POSITION_RAD, ExperimentLine
from hdbench.records.quantity import Quantity

__all__ = [
    "by_position",
    "consistency_interval",
    "mean_gain",
    "position_numbers",
    "shared_dof",
    "vangel_interval",
]

_UNBALANCED, _REPEATED, _RESIDUAL = "positions-unbalanced", "repetitions", "residual"


def by_position(lines: tuple[ExperimentLine, ...]) -> list[list[ExperimentLine]]:
    """Group experiments by flexspline position; a full turn is the same position."""
    groups: list[list[ExperimentLine]] = []
    for line in lines:
        for group in groups:
            apart = math.remainder(line.position_rad - group[0].position_rad, 2.0 * math.pi)
            if abs(apart) < POSITION_RAD:
                group.append(line)
                break
        else:
            groups.append([line])
    return groups


def position_numbers(lines: tuple[ExperimentLine, ...]) -> tuple[int, ...]:
    """Return the number of the position of each experiment, from 0."""
    number = {line.id: k for k, group in enumerate(by_position(lines)) for line in group}
    return tuple(number[line.id] for line in lines)


def mean_gain(lines: tuple[ExperimentLine, ...]) -> tuple[Quantity, str, str]:
    """Return the mean gain with the uncertainty of a mean over flexspline positions.

    Parameters
    ----------
    lines : tuple of ExperimentLine
        At least one experiment.

    Returns
    -------
    gain : Quantity
        Plain mean of the gains, N m/V.
    basis : str
        ``positions``, ``positions-unbalanced``; with a single position ``repetitions`` or
        ``residual``.
    reason : str
        One line that says what the uncertainty rests on.

    Notes
    -----
    What is estimated is the gain averaged over flexspline positions. The position is a random
    effect; directions and ranges are fixed effects whose average is wanted. Experiments at one
    position share its effect and are not independent: with P positions and as many experiments
    of each direction and range at each, ``std = s / sqrt(P)``, s the standard deviation of the
    P position means, with P - 1 dof; position effect, differences of direction between
    positions and reading noise are all in s. Positions that hold different experiments: see
    `plain_mean`. With a single position the spread between positions is unknown: the scatter of
    repeated experiments, or else the pooled residual of the lines, gives the uncertainty at this
    position alone, which is marked.

    References
    ----------
    .. [1] S. R. Searle, G. Casella, C. E. McCulloch, Variance Components, Wiley 1992, chapter 3.
    """
    gains = np.array([line.gain_nm_per_v.value for line in lines])
    value = float(gains.mean())
    groups = by_position(lines)
    if len(groups) < 2:
        return _one_position(lines, value)
    means = [math.fsum(x.gain_nm_per_v.value for x in group) / len(group) for group in groups]
    spread = float(np.std(means, ddof=1))
    cells = [sorted((x.direction, x.range) for x in group) for group in groups]
    if all(cell == cells[0] for cell in cells):
        reason = f"spread of {len(groups)} position means"
        std = spread / math.sqrt(len(groups))
        return Quantity(value, std, float(len(groups) - 1)), "positions", reason
    reason = (
        f"spread of {len(groups)} positions that do not hold the same experiments: what differs "
        "between these is in the uncertainty"
    )
    fixed = [(line.direction, line.range) for line in lines]
    return plain_mean(gains.tolist(), position_numbers(lines), fixed), _UNBALANCED, reason


def _one_position(lines: tuple[ExperimentLine, ...], value: float) -> tuple[Quantity, str, str]:
    """Return the mean gain at a single position: by repeated experiments, else by residuals."""
    cells: dict[tuple[str, str], list[float]] = {}
    for line in lines:
        cells.setdefault((line.direction, line.range), []).append(line.gain_nm_per_v.value)
    n = len(lines)
    free = n - len(cells)
    without = "leaves out the spread between positions"
    if free > 0:
        squares = math.fsum(float(np.var(gains)) * len(gains) for gains in cells.values())
        reason = f"one flexspline position: the spread of repeated experiments; {without}"
        return Quantity(value, math.sqrt(squares / free / n), float(free)), _REPEATED, reason
    variances = [line.gain_nm_per_v.std**2 for line in lines]
    dof = math.fsum(line.gain_nm_per_v.dof or 0.0 for line in lines)
    reason = (
        "one flexspline position: the uncertainty comes from the residuals of the lines and "
        f"{without}"
    )
    return Quantity(value, math.sqrt(math.fsum(variances)) / n, dof), _RESIDUAL, reason


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
    gains = [np.array([x.gain_nm_per_v.value for x in group]) for group in groups]
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
