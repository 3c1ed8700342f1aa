"""One history: its charts, signals, changes of the level, and drift."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hdbench.records import FloatArray, Quantity
from hdbench.trend.charts import (
    CHARTS,
    LEAST_RUNS,
    Chart,
    Limits,
    Step,
    control_chart,
    find_limits,
    find_step,
)

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
    """Study one history."""
    if values.size < LEAST_RUNS:
        why = f"{values.size} runs; needed: {LEAST_RUNS} for limits"
        return History(None, None, (), (), None, why)
    if not np.mean(np.abs(np.diff(values))) > 0.0:
        return History(None, None, (), (), None, "no scatter: every run says the same")
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
