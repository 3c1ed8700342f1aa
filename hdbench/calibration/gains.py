"""Mean gain with the position as random effect, scatter within and between, outliers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.calibration.lines import position_number
from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray
from hdbench.results.calibration import ExperimentLine, MixedModel, Outlier, PositionVariance

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
    from scipy.special import fdtrc

    p, n = len(groups), sum(len(g) for g in groups)
    if p < 2 or n <= p:
        return None
    of_positions, inside = _sums_of_squares(groups)
    between, within = of_positions / (p - 1), inside / (n - p)
    q = (n - sum(len(g) ** 2 for g in groups) / n) / (p - 1)
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
        probability=None if ratio is None else float(fdtrc(p - 1, n - p, ratio)),
        repeatability_nm_per_v=math.sqrt(within),
        between_positions_nm_per_v=math.sqrt(place),
        reproducibility_nm_per_v=math.sqrt(variance),
        intraclass_correlation=place / variance if variance > 0.0 else None,
        mean_std_nm_per_v=math.sqrt(between / n),
        mean_dof=p - 1,
    )


def _sums_of_squares(groups: Sequence[Sequence[float]]) -> tuple[float, float]:
    """Return the sum of squares between positions, and within them."""
    arrays = [np.asarray(g, dtype=float) for g in groups]
    total = float(np.concatenate(arrays).mean())
    between = math.fsum(len(a) * (float(a.mean()) - total) ** 2 for a in arrays)
    return between, math.fsum(float(((a - a.mean()) ** 2).sum()) for a in arrays)


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
    between, within = _sums_of_squares([[x.gain_nm_per_v for x in group] for group in groups])
    parts = ((between, len(groups) - 1), (within, len(lines) - len(groups)))
    loss = sum(square**2 / dof for square, dof in parts if dof)
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
    high, low = _chi_square_ends(dof)
    return consistency * math.sqrt(dof / high), consistency * math.sqrt(dof / low)


def _chi_square_ends(dof: float) -> tuple[float, float]:
    """Return the upper and the lower quantile of chi-square that hold 95 %."""
    from scipy.special import chdtri

    # chdtri takes the probability above the quantile
    return float(chdtri(dof, _TAIL)), float(chdtri(dof, 1.0 - _TAIL))


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
    n = dof + 1.0
    ends: list[float | None] = []
    for u in _chi_square_ends(dof):
        square = ((u + 2.0) / n - 1.0) * consistency**2 + u / dof
        ends.append(consistency / math.sqrt(square) if square > 0.0 else None)
    low, high = ends
    return (0.0 if low is None else low), high


@dataclass(frozen=True, slots=True)
class Extreme:
    """One value that stands off."""

    index: int
    # distance from the mean over the standard deviation, without the values that stand further off;
    # what chance allows
    statistic: float
    limit: float


def grubbs_limit(n: int) -> float:
    """Return the largest distance from the mean over s that chance allows in n normal values.

    Notes
    -----
    ``(n - 1)/sqrt(n) sqrt(t^2 / (n - 2 + t^2))`` with t the quantile at ``1 - 0.05 / (2 n)``
    of n - 2 degrees of freedom.

    References
    ----------
    .. [1] F. E. Grubbs, Technometrics 11 (1969) 1, doi:10.1080/00401706.1969.10490657.
    """
    from scipy.special import stdtrit

    t = float(stdtrit(n - 2, 1.0 - 0.05 / (2.0 * n)))
    return float((n - 1) / np.sqrt(n) * np.sqrt(t**2 / (n - 2 + t**2)))


def extreme_values(values: Sequence[float]) -> tuple[Extreme, ...]:
    """Find values that stand off the others, several that hide each other among them.

    Notes
    -----
    The value furthest from the mean is taken out, the next sought among the rest, and so on; as
    many are named as the *last* step that was beyond its limit: two large ones that widen s and
    hide each other are then found. For one value this is Grubbs' test.

    References
    ----------
    .. [1] B. Rosner, Technometrics 25 (1983) 165, doi:10.1080/00401706.1983.10487848.
    """
    left = list(enumerate(float(v) for v in values))
    limit = min(10, len(left) // 3)
    seen: list[Extreme] = []
    count = 0
    scale = max((abs(v) for _, v in left), default=0.0)
    while len(seen) < limit and len(left) >= 3:
        numbers = np.array([v for _, v in left])
        std = float(numbers.std(ddof=1))
        # a spread at rounding level says nothing about a value
        if not std > 1e-12 * scale:
            break
        far = int(np.argmax(np.abs(numbers - numbers.mean())))
        statistic = float(abs(numbers[far] - numbers.mean())) / std
        found = Extreme(left[far][0], statistic, grubbs_limit(len(left)))
        seen.append(found)
        if found.statistic > found.limit:
            count = len(seen)
        left.pop(far)
    return tuple(seen[:count])


def gain_outliers(lines: tuple[ExperimentLine, ...]) -> tuple[Outlier, ...]:
    """Find experiments whose gains stand off the others.

    Notes
    -----
    Gains that share a position share its effect: they would hide or accuse each other in a test
    of all gains. The position means are searched, and the gains of a position with three or more
    about their own mean.
    """
    groups = by_position(lines)
    means = [float(np.mean([x.gain_nm_per_v for x in group])) for group in groups]
    found = [_outlier(groups[o.index], o) for o in extreme_values(means)]
    for group in groups:
        own = extreme_values([x.gain_nm_per_v for x in group])
        found += [_outlier([group[o.index]], o) for o in own]
    return tuple(found)


def _outlier(own: list[ExperimentLine], found: Extreme) -> Outlier:
    """Return one experiment, or all of a position, that stand off."""
    return Outlier(
        kind="gain" if len(own) == 1 else "position",
        experiment=", ".join(line.id for line in own),
        position_rad=own[0].position_rad,
        statistic=found.statistic,
        limit=found.limit,
    )
