"""Series of load steps, groups of them, and readings that stand off their common course."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.calibration.lines import ZERO_SHARE, position_number
from hdbench.calibration.readings import TakenReading
from hdbench.records.trace import FloatArray
from hdbench.results.calibration import Outlier

# share of the smallest distance between two loads within which torques are one step: a reference
# sensor that is read at each load differs from series to series, but not by a third of a step
_SAME_STEP = 0.3
# and never more than this share of the largest, where there is a single load
_SAME_LOAD = 0.05

_Key = tuple[str, str, str, float | None]


@dataclass(frozen=True, slots=True)
class LoadSeries:
    """One loading experiment on the steps of its group."""

    # identifier of the experiment
    id: str
    # flexspline position, rad
    position_rad: float
    # number of the position among those of the group, from 0
    position: int
    # number of the mounting; None where the file does not tell: one per position
    mounting: int | None
    # 0 for the first series in its mounting
    repeat: int
    # shape (m,): Deflection while loading and while unloading, V: reading less the zero before the
    # series, positive with the load; NaN where there is none
    up_v: FloatArray
    down_v: FloatArray
    # readings at no load, V
    zero_before_v: float | None
    zero_after_v: float | None
    # whether the zero is the intercept of the series' own line, for want of a reading
    zero_by_line: bool


@dataclass(frozen=True, slots=True)
class StepGroup:
    """Series of one direction, range, way of loading and arm."""

    # `cw` or `ccw`; `low` or `full`; `single` or `couple`
    direction: str
    range: str
    loading: str
    # arm where the readings name one
    arm_length_m: float | None
    # shape (m,): Applied torque of each step, N m, rising, above 0
    torque_nm: FloatArray
    # at least one
    series: tuple[LoadSeries, ...]

    @property
    def place(self) -> dict[str, Any]:
        """What the series have in common beside their steps."""
        names = ("direction", "range", "loading", "arm_length_m")
        return {name: getattr(self, name) for name in names}

    def first_series(self) -> tuple[LoadSeries, ...]:
        """Return one series of each position: the first, which no other went before."""
        chosen: dict[int, LoadSeries] = {}
        for series in sorted(self.series, key=lambda s: (s.position, s.repeat)):
            chosen.setdefault(series.position, series)
        return tuple(chosen.values())


def step_groups(readings: Sequence[TakenReading], loading: str) -> tuple[StepGroup, ...]:
    """Order the readings by direction, range, way of loading and arm."""
    groups: dict[_Key, list[TakenReading]] = {}
    for taken in readings:
        reading, detail = taken.reading, taken.detail
        key = (reading.direction, reading.range, detail.loading or loading, detail.arm_length_m)
        groups.setdefault(key, []).append(taken)
    made = (_group(key, members) for key, members in groups.items())
    return tuple(sorted((g for g in made if g is not None), key=lambda g: g.range != "full"))


def _group(key: _Key, members: list[TakenReading]) -> StepGroup | None:
    sizes = [abs(t.reading.torque_nm) for t in members]
    largest = max(sizes)
    if not largest > 0.0:
        return None
    experiments: dict[str, list[TakenReading]] = {}
    for taken in members:
        experiments.setdefault(taken.reading.experiment, []).append(taken)
    grid = _load_grid(experiments.values(), ZERO_SHARE * largest)
    places: list[float] = []
    counts: dict[tuple[int, int | None], int] = {}
    series = []
    for own in experiments.values():
        position = position_number(own[0].reading.position_rad, places)
        mounting = own[0].detail.mounting
        counted = counts.get((position, mounting), 0)
        counts[position, mounting] = counted + 1
        told = own[0].detail.repeat
        repeat = counted if told is None else told
        place = (position, mounting, repeat)
        series.append(_series(own, place, grid, ZERO_SHARE * largest))
    return StepGroup(*key, np.array(grid), tuple(series))


def _load_grid(experiments: Iterable[list[TakenReading]], zero_nm: float) -> list[float]:
    """Return the steps: torques of all series, those of one load made one."""
    torques: list[float] = []
    smallest = math.inf
    for own in experiments:
        for branch in ("up", "down"):
            loads = sorted(
                {
                    abs(t.reading.torque_nm)
                    for t in own
                    if t.reading.series == branch and abs(t.reading.torque_nm) > zero_nm
                }
            )
            torques += loads
            # rounding makes two of one torque: a distance of that size is none
            gaps = [b - a for a, b in itertools.pairwise(loads) if b - a > 1e-6 * b]
            smallest = min([smallest, *gaps])
    reach, torques_end = _SAME_STEP * smallest, max(torques)
    steps: list[list[float]] = []
    for torque in sorted(torques):
        if steps and torque - steps[-1][-1] <= min(reach, _SAME_LOAD * torques_end):
            steps[-1].append(torque)
        else:
            steps.append([torque])
    return [s[0] if s[0] == s[-1] else math.fsum(s) / len(s) for s in steps]


def _series(
    own: list[TakenReading], place: tuple[int, int | None, int], grid: list[float], zero_nm: float
) -> LoadSeries:
    torque = np.array([abs(t.reading.torque_nm) for t in own])
    volts = np.array([t.reading.reading_v for t in own])
    up = np.array([t.reading.series == "up" for t in own])
    zeros = torque <= zero_nm
    before = float(volts[zeros & up][0]) if (zeros & up).any() else None
    after = float(volts[zeros & ~up][-1]) if (zeros & ~up).any() else None
    slope, intercept = _line(torque, volts)
    zero = intercept if before is None else before
    # ccw torques give the other sign, and so does a bridge wired the other way round
    turn = 1.0 if slope >= 0.0 else -1.0
    branches = [
        _branch(torque[chosen], turn * (volts[chosen] - zero), turn * slope, grid)
        for chosen in (up & ~zeros, ~up & ~zeros)
    ]
    return LoadSeries(
        own[0].reading.experiment,
        own[0].reading.position_rad,
        *place,
        branches[0],
        _turned(branches[0], branches[1]),
        before,
        after,
        before is None,
    )


def _turned(up_v: FloatArray, down_v: FloatArray) -> FloatArray:
    """Return unloading with the largest step: the last reading of loading is its first."""
    known = np.flatnonzero(np.isfinite(up_v))
    lower = np.isfinite(down_v)
    if not len(known) or not lower.any() or np.flatnonzero(lower)[-1] >= known[-1]:
        return down_v
    out = down_v.copy()
    out[known[-1]] = up_v[known[-1]]
    return out


def _line(torque: FloatArray, volts: FloatArray) -> tuple[float, float]:
    """Return slope and intercept of volts on torque."""
    offset = torque - torque.mean()
    spread = float(offset @ offset)
    slope = float(offset @ volts) / spread if spread > 0.0 else 0.0
    return slope, float(volts.mean()) - slope * float(torque.mean())


def _branch(
    torque: FloatArray, deflection: FloatArray, slope: float, grid: list[float]
) -> FloatArray:
    """Return the mean deflection at each step, carried to its torque along the series' line."""
    out = np.full(len(grid), np.nan)
    steps = np.array(grid)
    if not len(torque):
        return out
    nearest = np.abs(torque[:, None] - steps[None, :]).argmin(axis=1)
    carried = deflection + slope * (steps[nearest] - torque)
    for k in range(len(grid)):
        own = carried[nearest == k]
        if len(own):
            out[k] = own.mean()
    return out


# chance that a group without a bad reading shows one
_LEVEL = 0.05
# one more reading is looked at for so many
_EVERY = 10
# singular values below this share of the largest are rounding, and so are distances below this
# share of the largest deflection
_SMALL, _ROUNDING = 1e-10, 1e-12
# a value with less than this share of its variance left alone fixes a coefficient
_NO_FREEDOM = 1e-6
# fewer series have no common course to stand off from
_MIN_SERIES = 3

_Places = NDArray[np.intp]


def odd_readings(group: StepGroup) -> tuple[Outlier, ...]:
    """Find readings that stand off the common course of their group.

    Notes
    -----
    Every deflection, over the sensitivity of its series, is its series' own slope times the torque
    plus a course of its branch that all series share: a difference of gain, curvature and
    hysteresis are then no reason to name a reading. The largest externally studentised residual
    is compared with Student's t at 0.05 / (2 n), the reading taken out, the rest fitted again; as
    many are named as the last step that was beyond its limit, so that two do not hide each other.
    """
    rows = np.array([[s.up_v, s.down_v] for s in group.series])
    there = np.isfinite(rows)
    if int(there.any(axis=(1, 2)).sum()) < _MIN_SERIES:
        return ()
    series, branch, step = np.nonzero(there)
    design = _design(series, branch, step, group)
    scale = _sensitivities(rows, there, group)
    y = (rows / scale[:, None, None])[there]
    seen, count = [], 0
    left = np.arange(len(y))
    for _ in range(1 + len(y) // _EVERY):
        furthest = _furthest(design[left], y[left])
        if furthest is None:
            break
        place, apart, statistic, limit = furthest
        k = int(left[place])
        off = apart * float(scale[series[k]])
        name = "up" if branch[k] == 0 else "down"
        seen.append(
            Outlier(
                kind="reading",
                experiment=group.series[series[k]].id,
                series=name,
                torque_nm=float(group.torque_nm[step[k]]),
                off_v=off,
                statistic=statistic,
                limit=limit,
            )
        )
        if statistic > limit:
            count = len(seen)
        left = np.delete(left, place)
    return tuple(seen[:count])


def _sensitivities(rows: FloatArray, there: NDArray[np.bool_], group: StepGroup) -> FloatArray:
    """Return the sensitivity of each series over their median, 1 where it has none."""
    torque = np.where(there, group.torque_nm, 0.0)
    product = (torque * np.where(there, rows, 0.0)).sum(axis=(1, 2))
    square = (torque**2).sum(axis=(1, 2))
    slope = np.divide(product, square, out=np.zeros(len(rows)), where=square > 0.0)
    usable = slope > 0.0
    if not usable.any():
        return np.ones(len(rows))
    return np.where(usable, slope / float(np.median(slope[usable])), 1.0)


def _design(series: _Places, branch: _Places, step: _Places, group: StepGroup) -> FloatArray:
    n_series, n_steps = len(group.series), len(group.torque_nm)
    out = np.zeros((len(series), n_series + 2 * n_steps))
    rows = np.arange(len(series))
    out[rows, series] = group.torque_nm[step] / group.torque_nm[-1]
    out[rows, n_series + branch * n_steps + step] = 1.0
    return out


def _furthest(design: FloatArray, y: FloatArray) -> tuple[int, float, float, float] | None:
    """Return place, distance, externally studentised residual and limit of the furthest value."""
    from scipy.special import stdtrit

    # the slopes' common part is also one of the course: the projection does not mind
    basis, sizes, _ = np.linalg.svd(design, full_matrices=False)
    basis = basis[:, sizes > _SMALL * sizes[0]]
    free = len(y) - basis.shape[1] - 1
    if free < 1:
        return None
    off = y - basis @ (basis.T @ y)
    open_ = 1.0 - (basis**2).sum(axis=1)
    judged = (open_ > _NO_FREEDOM) & (np.abs(off) > _ROUNDING * float(np.max(np.abs(y))))
    if not judged.any():
        return None
    open_ = np.maximum(open_, _NO_FREEDOM)
    floor = (_ROUNDING * float(np.max(np.abs(y)))) ** 2
    others = np.maximum((float(off @ off) - off**2 / open_) / free, floor)
    statistic = np.where(judged, np.abs(off) / np.sqrt(open_ * others), 0.0)
    place = int(np.argmax(statistic))
    limit = float(stdtrit(free, 1.0 - _LEVEL / (2.0 * len(y))))
    return place, float(off[place]), float(statistic[place]), limit
