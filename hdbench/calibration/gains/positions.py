"""Gains over flexspline positions: mean, variance within and between, spread of all gains."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hdbench.calibration.gains.mixed import plain_mean
from hdbench.calibration.lines import position_number
from hdbench.records.quantity import Quantity
from hdbench.results.calibration import ExperimentLine, PositionVariance

_UNBALANCED, _REPEATED, _RESIDUAL = "positions-unbalanced", "repetitions", "residual"
# probability beyond each end of an interval of 95 %
_TAIL = (1.0 - 0.95) / 2.0


def position_numbers(lines: tuple[ExperimentLine, ...]) -> tuple[int, ...]:
    """Return the number of the position of each experiment, from 0."""
    places: list[float] = []
    return tuple(position_number(line.position_rad, places) for line in lines)


def by_position(lines: tuple[ExperimentLine, ...]) -> list[list[ExperimentLine]]:
    """Group experiments by flexspline position."""
    groups: dict[int, list[ExperimentLine]] = {}
    for number, line in zip(position_numbers(lines), lines, strict=True):
        groups.setdefault(number, []).append(line)
    return list(groups.values())


def mean_gain(lines: tuple[ExperimentLine, ...]) -> tuple[Quantity, str, str]:
    """Return the mean gain with the uncertainty of a mean over flexspline positions.

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
    gains = np.array([line.gain_nm_per_v for line in lines])
    value = float(gains.mean())
    groups = by_position(lines)
    if len(groups) < 2:
        return _one_position(lines, value)
    means = [math.fsum(x.gain_nm_per_v for x in group) / len(group) for group in groups]
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
        cells.setdefault((line.direction, line.range), []).append(line.gain_nm_per_v)
    n = len(lines)
    free = n - len(cells)
    without = "leaves out the spread between positions"
    if free > 0:
        squares = math.fsum(float(np.var(gains)) * len(gains) for gains in cells.values())
        reason = f"one flexspline position: the spread of repeated experiments; {without}"
        return Quantity(value, math.sqrt(squares / free / n), float(free)), _REPEATED, reason
    variances = [(line.gain_std_nm_per_v or 0.0) ** 2 for line in lines]
    dof = math.fsum(line.gain_dof or 0.0 for line in lines)
    reason = (
        "one flexspline position: the uncertainty comes from the residuals of the lines and "
        f"{without}"
    )
    return Quantity(value, math.sqrt(math.fsum(variances)) / n, dof), _RESIDUAL, reason


def one_way(groups: Sequence[Sequence[float]]) -> PositionVariance | None:
    """Split the scatter of gains into within and between positions.

    Notes
    -----
    ``MSB = sum n_i (G_i - G)^2 / (p - 1)``, ``MSW = sum (G_ij - G_i)^2 / (N - p)``,
    ``s_pos^2 = max(0, (MSB - MSW) / q)`` with ``q = (N - sum n_i^2 / N) / (p - 1)``.

    References
    ----------
    .. [1] S. R. Searle, G. Casella, C. E. McCulloch, Variance Components, Wiley 1992, section 3.6.
    """
    p, n = len(groups), sum(len(g) for g in groups)
    if p < 2 or n <= p:
        return None
    arrays = [np.asarray(g, dtype=float) for g in groups]
    total = float(np.concatenate(arrays).mean())
    between = math.fsum(len(a) * (float(a.mean()) - total) ** 2 for a in arrays) / (p - 1)
    within = math.fsum(float(((a - a.mean()) ** 2).sum()) for a in arrays) / (n - p)
    q = (n - sum(len(a) ** 2 for a in arrays) / n) / (p - 1)
    place = max(0.0, (between - within) / q)
    ratio = between / within if within > 0.0 else None
    variance = place + within
    return PositionVariance(
        n_positions=p,
        n_experiments=n,
        replicates=q,
        mean_square_between=between,
        mean_square_within=within,
        f_ratio=ratio,
        probability=None if ratio is None else _tail(p - 1, n - p, ratio),
        repeatability_nm_per_v=math.sqrt(within),
        between_positions_nm_per_v=math.sqrt(place),
        reproducibility_nm_per_v=math.sqrt(variance),
        intraclass_correlation=place / variance if variance > 0.0 else None,
        mean_std_nm_per_v=math.sqrt(between / n),
        mean_dof=p - 1,
    )


def _tail(first: int, second: int, ratio: float) -> float:
    from scipy.special import fdtrc

    return float(fdtrc(first, second, ratio))


def any_one_position(found: PositionVariance) -> tuple[float, float]:
    """Return the standard uncertainty of the gain at one unknown position, and its dof.

    ``u^2 = u(mean)^2 + s_R^2``, both made of the two independent mean squares, to which
    Satterthwaite's formula is applied: ``u^2 = (1 + 1/p) MSB / q + (1 - 1/q) MSW``.
    """
    p, q = found.n_positions, found.replicates
    between, within = found.mean_square_between, found.mean_square_within or 0.0
    first = max(between, within) * (1.0 + 1.0 / p) / q
    second = within * (1.0 - 1.0 / q)
    loss = first**2 / (p - 1)
    if found.n_experiments > p:
        loss += second**2 / (found.n_experiments - p)
    variance = first + second
    return math.sqrt(variance), variance**2 / loss if loss > 0.0 else float(p - 1)


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


def consistency_interval(consistency: float, dof: float) -> tuple[float, float]:
    """Return the 95 % interval of a relative standard deviation by chi-square.

    Parameters
    ----------
    consistency : float
        Standard deviation over mean, at least 0.
    dof : float
        Degrees of freedom of that standard deviation, above 0.

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

    # chdtri takes the probability above the quantile
    high, low = float(chdtri(dof, _TAIL)), float(chdtri(dof, 1.0 - _TAIL))
    return consistency * math.sqrt(dof / high), consistency * math.sqrt(dof / low)


def vangel_interval(consistency: float, dof: float) -> tuple[float, float | None]:
    """Return the 95 % interval of a coefficient of variation of normal values.

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
    ends: list[float | None] = []
    # chdtri takes the probability above the quantile
    for u in (float(chdtri(dof, _TAIL)), float(chdtri(dof, 1.0 - _TAIL))):
        square = ((u + 2.0) / n - 1.0) * consistency**2 + u / dof
        ends.append(consistency / math.sqrt(square) if square > 0.0 else None)
    low, high = ends
    return (0.0 if low is None else low), high
