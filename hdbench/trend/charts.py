"""Charts of one history: individuals, moving range, EWMA; its signals, steps and drift."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from hdbench.records import FloatArray, Quantity

CHARTS = ("individuals", "moving-range", "ewma", "step")
# small enough for lasting shifts of one std, large enough to follow a step within some runs;
# Montgomery, Introduction to Statistical Quality Control, recommends .05 to .25
EWMA_WEIGHT = 0.2
# mean range of two normal values over their std, as the NIST/SEMATECH e-Handbook rounds it (6.3.2)
_D2 = 1.128
# std of the steps that are expected, in run-to-run stds: the prior of the probability of a change
_STEP_PRIOR_STD = 2.0
# two levels of two runs, and two degrees of freedom for the scatter about them
LEAST_RUNS = 6
# a level needs two runs: one alone is an outlier, which the individuals chart shows
_LEAST_LEVEL = 2
_DRAWS = 10_000
# finds the scatter between runs to 1e-4 of the largest range
_HALVINGS = 14
# numbers of one array of drawn histories
_CHUNK = 1_500_000
# runs whose stds differ by less share the limits of runs that are all alike
_ALIKE = 1.1


@dataclass(frozen=True, slots=True)
class Step:
    """The likeliest step of the level in one history.

    Parameters
    ----------
    index : int
        First run after it.
    probability : float
        Of a step anywhere, with even odds before the data, every place alike, and steps normal
        with a std of two run-to-run stds.
    log_odds : float
        Logarithm of the odds behind `probability`; the statistic of the chart ``step``.
    earliest, latest : int
        First run after the step, at 95 %.
    """

    index: int
    probability: float
    log_odds: float
    earliest: int
    latest: int


@dataclass(frozen=True, slots=True)
class Chart:
    """What is drawn of one history, or of many of one length.

    Parameters
    ----------
    values : ndarray, shape (..., n)
        The quantity, run by run.
    center : ndarray, shape (...)
        Mean of the runs, weighted by 1 / stds^2.
    stds : ndarray, shape (..., n)
        Std of a single run about the center: own uncertainty and scatter between runs.
    between_std : ndarray, shape (...)
        Scatter between runs beyond their own uncertainties.
    moving_range, expected_range : ndarray, shape (..., n - 1)
        Difference to the run before, and its mean where nothing but scatter is at work.
    ewma, ewma_stds : ndarray, shape (..., n)
        Exponentially weighted moving average that starts at the center, and its std.
    """

    values: FloatArray
    center: FloatArray
    stds: FloatArray
    between_std: FloatArray
    moving_range: FloatArray
    expected_range: FloatArray
    ewma: FloatArray
    ewma_stds: FloatArray

    def scores(self) -> dict[str, FloatArray]:
        """Return each chart's statistic run by run, in units that `Limits` hold factors of."""
        center = self.center[..., None]
        return {
            "individuals": np.abs(self.values - center) / self.stds,
            "moving-range": self.moving_range / self.expected_range,
            "ewma": np.abs(self.ewma - center) / self.ewma_stds,
        }


@dataclass(frozen=True, slots=True)
class Limits:
    """Factors that a stable history passes with a stated probability, all charts together.

    Parameters
    ----------
    individuals, ewma : float
        Limits are the center plus and minus so many stds.
    moving_range : float
        The upper limit is so many expected ranges.
    step : float
        Largest log-odds of a step.
    """

    individuals: float
    moving_range: float
    ewma: float
    step: float


def control_chart(values: FloatArray, own_stds: FloatArray) -> Chart:
    """Return the charts of one history, or of many of one length.

    Notes
    -----
    A run has variance ``t^2 + u_i^2``: scatter between runs and own uncertainty. ``t`` makes the
    moving ranges on average as large as expected, ``1.128 sqrt(t^2 + (u_i^2 + u_(i-1)^2) / 2)``.
    Where the runs scatter less than their own uncertainties say, a part of those is common to all
    runs; they are then scaled down to the scatter, with their ratios kept.

    References
    ----------
    NIST/SEMATECH e-Handbook of Statistical Methods, 6.3.2.2 (individuals) and 6.3.2.4 (EWMA).
    """
    stds, between = _stds(values, own_stds)
    center = _centers(values, stds)
    expected = _D2 * np.sqrt(0.5 * (stds[..., 1:] ** 2 + stds[..., :-1] ** 2))
    averages = _ewma(values, center, stds)
    return Chart(values, center, stds, between, np.abs(np.diff(values)), expected, *averages)


def find_step(values: FloatArray, stds: FloatArray) -> Step:
    """Return the likeliest step of the level.

    Notes
    -----
    The odds of a step at each place are the Bayes factor of the two-sample t statistic with a
    normal prior of the step (Goenen, Johnson, Lu, Westfall, The American Statistician 59, 2005);
    its scale is estimated from the runs about both levels.
    """
    odds = _step_odds(values, stds)
    total = _mean_odds(odds)
    share = np.exp(odds - odds.max())
    share /= share.sum()
    likeliest = np.argsort(share)[::-1]
    count = int(np.searchsorted(np.cumsum(share[likeliest]), 0.95)) + 1
    within = likeliest[:count] + _LEAST_LEVEL
    return Step(
        int(np.argmax(odds)) + _LEAST_LEVEL,
        float(1.0 / (1.0 + math.exp(-total))) if total < 700.0 else 1.0,
        float(total),
        int(within.min()),
        int(within.max()),
    )


def find_limits(
    chart: Chart, own_stds: FloatArray, probability: float, draw: np.random.Generator
) -> Limits:
    """Return the limits that a stable history passes with a stated probability.

    Notes
    -----
    Stable histories are drawn with the stds of this one and charted as this one is, center and
    scatter estimated from each; every chart gets the same share of the false alarms. So what the
    estimates and the dependence of the charts on each other do is counted in.
    """
    if chart.stds.max() < _ALIKE * chart.stds.min():
        return _alike(chart.values.size, probability, int(draw.integers(2**31)))
    return _drawn(chart.stds, own_stds, probability, draw)


@lru_cache(maxsize=256)
def _alike(n: int, probability: float, seed: int) -> Limits:
    draw = np.random.default_rng(seed)
    return _drawn(np.ones(n), np.zeros(n), probability, draw)


def _drawn(
    stds: FloatArray, own: FloatArray, probability: float, draw: np.random.Generator
) -> Limits:
    size = max(1, _CHUNK // stds.size)
    parts = []
    for first in range(0, _DRAWS, size):
        count = min(size, _DRAWS - first)
        parts.append(_largest(draw.normal(size=(count, stds.size)) * stds, own))
    largest = np.concatenate(parts)
    # share of histories that reach as far on each chart; the least of them decides
    tails = 1.0 - np.argsort(np.argsort(largest, axis=0), axis=0) / len(largest)
    share = float(np.quantile(tails.min(axis=1), probability))
    found = np.quantile(largest, 1.0 - share, axis=0)
    return Limits(*(float(x) for x in found))


def _largest(y: FloatArray, own: FloatArray) -> FloatArray:
    """Return the largest statistic of each history on each chart, shape (m, 4)."""
    chart = control_chart(y, own)
    largest = [np.max(scores, axis=-1) for scores in chart.scores().values()]
    return np.column_stack([*largest, _mean_odds(_step_odds(y, chart.stds))])


def _stds(y: FloatArray, own: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return stds of the runs and the scatter between runs."""
    ranges = np.abs(np.diff(y)) / _D2
    pairs = 0.5 * (own[1:] ** 2 + own[:-1] ** 2)
    if not np.any(pairs):
        low = np.mean(ranges, axis=-1)
    else:
        high = np.max(ranges, axis=-1)
        low = np.zeros_like(high)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            above = np.mean(ranges / np.sqrt(middle[..., None] ** 2 + pairs), axis=-1) > 1.0
            low, high = np.where(above, middle, low), np.where(above, high, middle)
    scale = np.ones_like(low)
    if np.all(pairs > 0.0):
        scale = np.minimum(1.0, np.mean(ranges / np.sqrt(pairs), axis=-1))
    return scale[..., None] * np.sqrt(low[..., None] ** 2 + own**2), low


def _centers(y: FloatArray, stds: FloatArray) -> FloatArray:
    weights = 1.0 / stds**2
    centers: FloatArray = np.sum(weights * y, axis=-1) / np.sum(weights, axis=-1)
    return centers


def _ewma(
    y: FloatArray, center: FloatArray, stds: FloatArray, weight: float = EWMA_WEIGHT
) -> tuple[FloatArray, FloatArray]:
    level, variance = center, np.zeros_like(center)
    levels, variances = np.empty_like(y), np.empty_like(y)
    for k in range(y.shape[-1]):
        level = weight * y[..., k] + (1.0 - weight) * level
        variance = (weight * stds[..., k]) ** 2 + (1.0 - weight) ** 2 * variance
        levels[..., k], variances[..., k] = level, variance
    return levels, np.sqrt(variances)


def _step_odds(y: FloatArray, stds: FloatArray) -> FloatArray:
    """Return the log Bayes factor of a step before run 2 ... n - 2, shape (..., n - 3)."""
    typical = np.median(stds, axis=-1, keepdims=True)
    weights = (typical / stds) ** 2
    z = (y - _centers(y, stds)[..., None]) / typical
    before = np.cumsum(weights, axis=-1)
    sums = np.cumsum(weights * z, axis=-1)
    first, total = before[..., _LEAST_LEVEL - 1 : -_LEAST_LEVEL], before[..., -1:]
    low = sums[..., _LEAST_LEVEL - 1 : -_LEAST_LEVEL]
    variance = 1.0 / first + 1.0 / (total - first)
    step = (sums[..., -1:] - low) / (total - first) - low / first
    explained = step**2 / variance
    dof = y.shape[-1] - 2
    rest = np.sum(weights * z**2, axis=-1, keepdims=True) - explained
    ratio = explained / np.maximum(rest, 1e-12 * (rest + explained))  # t^2 / dof
    shrunk = variance / (variance + _STEP_PRIOR_STD**2)
    gain = np.log1p(ratio) - np.log1p(ratio * shrunk)
    odds: FloatArray = 0.5 * np.log(shrunk) + 0.5 * (dof + 1) * gain
    return odds


def _mean_odds(odds: FloatArray) -> FloatArray:
    top = odds.max(axis=-1)
    mean: FloatArray = top + np.log(np.mean(np.exp(odds - top[..., None]), axis=-1))
    return mean


# the limit is that of a whole history; a step within a part of it needs a probability of .95
_FURTHER_STEP = math.log(19.0)


@dataclass(frozen=True, slots=True)
class Signal:
    """A run that a stable history would not show.

    Parameters
    ----------
    chart : str
        One of `CHARTS`.
    index : int
        The run.
    value, limit : float
        The chart's statistic and its limit: stds, expected ranges, or log-odds.
    """

    chart: str
    index: int
    value: float
    limit: float


@dataclass(frozen=True, slots=True)
class Change:
    """A step of the level.

    Parameters
    ----------
    step : Step
        Where, how sure.
    size : Quantity
        Mean after it less mean before it, up to the neighbouring changes.
    """

    step: Step
    size: Quantity


@dataclass(frozen=True, slots=True)
class History:
    """What one history shows.

    Parameters
    ----------
    chart : Chart or None
        None where no limits can be given, for the reason in `why_not`.
    limits : Limits or None
        As the chart.
    signals : tuple of Signal
        Chart by chart, run by run; of the chart ``step`` the likeliest place alone.
    changes : tuple of Change
        Steps of the level, oldest first; none where a steady drift explains the runs better.
    drift_per_month : Quantity or None
        Slope between the changes; None where time does not pass.
    why_not : str
        Empty where there are limits.
    """

    chart: Chart | None
    limits: Limits | None
    signals: tuple[Signal, ...]
    changes: tuple[Change, ...]
    drift_per_month: Quantity | None
    why_not: str = ""


def study_history(
    values: FloatArray,
    own_stds: FloatArray,
    months: FloatArray,
    *,
    probability: float,
    draw: np.random.Generator,
) -> History:
    """Study one history; an uncertainty of 0 is one that a run does not state."""
    if values.size < LEAST_RUNS:
        why = f"{values.size} runs; needed: {LEAST_RUNS} for limits"
        return History(None, None, (), (), None, why)
    if not np.mean(np.abs(np.diff(values))) > 0.0:
        return History(None, None, (), (), None, "no scatter: every run says the same")
    stated = own_stds > 0.0
    if stated.any():
        # a run that states none is taken to be as good as the others
        own_stds = np.where(stated, own_stds, np.median(own_stds[stated]))
    chart = control_chart(values, own_stds)
    limits = find_limits(chart, own_stds, probability, draw)
    steps = _steps(values, chart.stds, limits.step, 0)
    likeliest = max(steps, key=lambda step: step.log_odds, default=None)
    if steps and _is_drift(values, chart.stds, months, steps):
        steps = []
    edges = [0, *(step.index for step in steps), values.size]
    changes = tuple(
        Change(step, _size(values, chart.stds, edges[k : k + 3])) for k, step in enumerate(steps)
    )
    return History(
        chart,
        limits,
        _signals(chart, limits, likeliest),
        changes,
        _drift(values, chart.stds, months, edges),
    )


def _steps(values: FloatArray, stds: FloatArray, limit: float, first: int) -> list[Step]:
    """Return the steps, oldest first: the likeliest, then those on either side of it."""
    if values.size < LEAST_RUNS or not np.ptp(values) > 0.0:
        return []
    step = find_step(values, stds)
    if step.log_odds <= limit:
        return []
    k = step.index
    here = replace(
        step, index=first + k, earliest=first + step.earliest, latest=first + step.latest
    )
    further = max(limit, _FURTHER_STEP)
    return [
        *_steps(values[:k], stds[:k], further, first),
        here,
        *_steps(values[k:], stds[k:], further, first + k),
    ]


def _signals(chart: Chart, limits: Limits, step: Step | None) -> tuple[Signal, ...]:
    found = []
    for name, scores in chart.scores().items():
        limit = getattr(limits, name.replace("-", "_"))
        late = chart.values.size - scores.size  # a range belongs to the later run
        found += [
            Signal(name, int(k) + late, float(scores[k]), limit)
            for k in np.flatnonzero(scores > limit)
        ]
    if step is not None:
        found.append(Signal(CHARTS[-1], step.index, step.log_odds, limits.step))
    return tuple(found)


def _is_drift(values: FloatArray, stds: FloatArray, months: FloatArray, steps: list[Step]) -> bool:
    """Return whether one straight line is better than the steps, by the BIC."""
    n, weights = values.size, 1.0 / stds
    edges = [0, *(step.index for step in steps), n]
    levels = np.repeat(np.eye(len(steps) + 1), np.diff(edges), axis=0)
    rests = []
    for terms in (np.column_stack([np.ones(n), months]), levels):
        fit = np.linalg.lstsq(terms * weights[:, None], values * weights, rcond=None)[0]
        rests.append(float(np.sum((weights * (values - terms @ fit)) ** 2)))
    # a step costs two numbers: its size and its place
    cost = [2.0 * math.log(n), (1.0 + 2.0 * len(steps)) * math.log(n)]
    line, level = (n * math.log(rest) + c for rest, c in zip(rests, cost, strict=True))
    return line < level


def _size(values: FloatArray, stds: FloatArray, edges: list[int]) -> Quantity:
    """Return the step between two neighbouring levels, with the scatter about both."""
    levels = [slice(edges[0], edges[1]), slice(edges[1], edges[2])]
    weights = [1.0 / stds[part] ** 2 for part in levels]
    means = [np.average(values[part], weights=w) for part, w in zip(levels, weights, strict=True)]
    rest = sum(
        float(np.sum(w * (values[part] - mean) ** 2))
        for part, w, mean in zip(levels, weights, means, strict=True)
    )
    dof = edges[2] - edges[0] - 2
    variance = rest / dof * sum(1.0 / float(w.sum()) for w in weights)
    return Quantity(float(means[1] - means[0]), math.sqrt(variance), float(dof))


def _drift(
    values: FloatArray, stds: FloatArray, months: FloatArray, edges: list[int]
) -> Quantity | None:
    """Return the common slope of all levels, by weighted least squares."""
    index = np.arange(values.size)
    level = np.searchsorted(edges[1:-1], index, side="right")
    time, y, variance = np.empty_like(values), np.empty_like(values), stds**2
    for k in range(len(edges) - 1):
        part = level == k
        weights = 1.0 / variance[part]
        time[part] = months[part] - np.average(months[part], weights=weights)
        y[part] = values[part] - np.average(values[part], weights=weights)
    spread = float(np.sum(time**2 / variance))
    dof = values.size - len(edges)
    if not spread > 0.0 or dof < 1:
        return None
    slope = float(np.sum(time * y / variance)) / spread
    rest = float(np.sum((y - slope * time) ** 2 / variance))
    return Quantity(slope, math.sqrt(rest / dof / spread), float(dof))
