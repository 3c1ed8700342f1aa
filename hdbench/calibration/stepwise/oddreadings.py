"""Readings that stand off what all series have in common."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdbench.calibration.stepwise.series import StepGroup
from hdbench.records.trace import FloatArray
from hdbench.results.calibration import Outlier

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
