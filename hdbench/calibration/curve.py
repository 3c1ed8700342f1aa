"""Shape of the curve: loop between loading and unloading, and lack of fit of a straight line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdbench.calibration.readings import TakenReading
from hdbench.records.trace import FloatArray
from hdbench.results.calibration import ExperimentLine, Loop, SeriesLackOfFit

# torques below this share of an experiment's largest are its zero, as for the steps
_ZERO_SHARE = 0.005


def loading_loops(
    readings: Sequence[TakenReading], lines: tuple[ExperimentLine, ...]
) -> dict[str, Loop]:
    """Return the loop of each experiment that was loaded and unloaded."""
    own: dict[str, list[TakenReading]] = {line.id: [] for line in lines}
    for taken in readings:
        own[taken.reading.experiment].append(taken)
    found: dict[str, Loop] = {}
    for line in lines:
        branches = [
            (
                np.array([abs(t.reading.torque_nm) for t in own[line.id] if t.reading.series == s]),
                np.array([t.reading.reading_v for t in own[line.id] if t.reading.series == s]),
            )
            for s in ("up", "down")
        ]
        top = max(abs(t.reading.torque_nm) for t in own[line.id])
        # anticlockwise torques are counted as positive too: so is then the gain
        sign = 1.0 if line.direction == "cw" else -1.0
        loop = loading_loop(branches[0], branches[1], sign * line.gain_nm_per_v, _ZERO_SHARE * top)
        if loop is not None:
            found[line.id] = loop
    return found


def loading_loop(
    up: tuple[FloatArray, FloatArray],
    down: tuple[FloatArray, FloatArray],
    gain: float,
    zero_nm: float,
) -> Loop | None:
    """Compare unloading with loading at equal torque.

    Notes
    -----
    Between its readings a branch is a straight line. Both are compared where either has a
    reading and the other reaches; between these points the difference is straight as well. The
    parts are least squares of ``h0 + 4 h1 t (1 - t)``, t the torque over its largest.
    """
    (t_up, v_up), (t_down, v_down) = _sorted(up), _sorted(down)
    if not (len(t_up) and len(t_down)):
        return None
    low, high = max(t_up[0], t_down[0]), min(t_up[-1], t_down[-1])
    top = float(max(t_up[-1], t_down[-1]))
    if not (high >= low and top > 0.0 and gain != 0.0):
        return None
    points = np.unique(np.concatenate([t_up, t_down]))
    points = points[(points >= low) & (points <= high)]
    apart = np.interp(points, t_down, v_down) - np.interp(points, t_up, v_up)
    far = int(np.argmax(np.abs(apart)))
    area = float(np.trapezoid(apart, points)) if len(points) > 1 else 0.0
    zero = _zero_return(up, down, zero_nm)
    constant, lens = _shape(points, apart, top, zero_nm)
    returned = None if zero is None else zero * gain
    return Loop(
        largest_nm=float(apart[far]) * gain,
        at_torque_nm=float(points[far]),
        relative=abs(float(apart[far]) * gain) / top,
        largest_torque_nm=top,
        area_v_nm=area,
        area_relative=abs(area * gain) / top**2,
        zero_return_nm=returned,
        zero_return_relative=None if returned is None else returned / top,
        constant_nm=None if constant is None else constant * gain,
        lens_nm=None if lens is None else lens * gain,
    )


def _sorted(branch: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return a branch by rising torque, readings of one torque averaged."""
    torque, volts = branch
    steps, places = np.unique(torque, return_inverse=True)
    count = np.bincount(places, minlength=len(steps))
    return steps, np.bincount(places, weights=volts, minlength=len(steps)) / np.maximum(count, 1)


def _zero_return(
    up: tuple[FloatArray, FloatArray], down: tuple[FloatArray, FloatArray], zero_nm: float
) -> float | None:
    before, after = up[1][up[0] <= zero_nm], down[1][down[0] <= zero_nm]
    if not (len(before) and len(after)):
        return None
    return float(after[-1] - before[0])


def _shape(
    points: FloatArray, apart: FloatArray, top: float, zero_nm: float
) -> tuple[float | None, float | None]:
    loaded = points > zero_nm
    if int(loaded.sum()) < 3:
        return None, None
    share = points[loaded] / top
    design = np.column_stack([np.ones(len(share)), 4.0 * share * (1.0 - share)])
    found = np.linalg.lstsq(design, apart[loaded], rcond=None)[0]
    return float(found[0]), float(found[1])


def series_lack_of_fit(torque_nm: FloatArray, deflection_v: FloatArray) -> SeriesLackOfFit | None:
    """Test straightness with one slope for each series.

    Notes
    -----
    ``r_jk = X_jk - S_j T_k`` with the slope of each series through zero, ``c_k`` their mean;
    ``SS_lof = J sum c_k^2`` with m - 1 dof, ``SS_pe = sum (r_jk - c_k)^2`` with (J - 1)(m - 1).
    The gain may differ from series to series without hiding a curve that all share.
    """
    rows = deflection_v[np.isfinite(deflection_v).all(axis=1)]
    n_series, steps = rows.shape
    if n_series < 1 or steps < 2:
        return None
    square = float(torque_nm @ torque_nm)
    slopes = rows @ torque_nm / square
    left = rows - np.outer(slopes, torque_nm)
    curve = left.mean(axis=0)
    lack = n_series * float(curve @ curve)
    pure = float(((left - curve) ** 2).sum())
    dof = (steps - 1, (n_series - 1) * (steps - 1))
    ratio, probability = _test(lack, dof[0], pure, dof[1])
    top = float(np.max(np.abs(rows.mean(axis=0))))
    return SeriesLackOfFit(
        curve_v=tuple(curve.tolist()),
        relative=float(np.max(np.abs(curve))) / top if top > 0.0 else 0.0,
        f_ratio=ratio,
        probability=probability,
        dof=dof,
        pooled_f_ratio=_pooled(torque_nm, rows),
    )


def _pooled(torque_nm: FloatArray, rows: FloatArray) -> float | None:
    """Return F of one line through zero for all series."""
    n_series, steps = rows.shape
    mean = rows.mean(axis=0)
    slope = float(mean @ torque_nm) / float(torque_nm @ torque_nm)
    off = mean - slope * torque_nm
    lack, pure = n_series * float(off @ off), float(((rows - mean) ** 2).sum())
    return _test(lack, steps - 1, pure, (n_series - 1) * steps)[0]


def _test(
    lack: float, lack_dof: int, pure: float, pure_dof: int
) -> tuple[float | None, float | None]:
    if not (pure > 0.0 and pure_dof > 0 and lack_dof > 0):
        return None, None
    from scipy.special import fdtrc

    ratio = max(0.0, lack) / lack_dof / (pure / pure_dof)
    return ratio, float(fdtrc(lack_dof, pure_dof, ratio))
