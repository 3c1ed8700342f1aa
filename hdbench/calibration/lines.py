"""Lines and curves of loading experiments: fit, doubtful readings, loop, lack of fit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hdbench.calibration.readings import TakenReading
from hdbench.errors import DataError
from hdbench.estimation.regression import LinearFit, ordinary_fit
from hdbench.records.loads import LoadReading
from hdbench.records.trace import FloatArray
from hdbench.results.calibration import ExperimentLine, ExperimentStep, Loop, SeriesLackOfFit

# positions closer than this are one position: a sixth of a tooth of 200, above what an encoder at
# the output or a mark made by hand repeats
_POSITION_RAD = 5e-3

# torques of one load step differ by less than this share of the largest torque
_STEP_SHARE = 1e-6
# chance that one experiment without a bad reading shows a doubtful one
_DOUBT_LEVEL = 0.05
# squares of larger numbers leave the range of a double; no torque or voltage comes near
_LARGEST = 1e100


def position_number(position_rad: float, places: list[float]) -> int:
    """Return the number of a position, a new one joins `places`; a full turn is the same."""
    for number, known in enumerate(places):
        if abs(math.remainder(position_rad - known, 2.0 * math.pi)) < _POSITION_RAD:
            return number
    places.append(position_rad)
    return len(places) - 1


def fit_experiment(
    own: Sequence[TakenReading], source: str
) -> tuple[ExperimentLine, tuple[ExperimentStep, ...]]:
    """Fit the line of one loading experiment.

    Notes
    -----
    ``torque = gain * reading + intercept``, ordinary least squares of torque on voltage, as in
    CIM-TR-97-06 section 3. A reading is doubtful where its externally studentised residual
    exceeds Student's t at 0.05 / (2 n): one experiment in twenty shows one by chance.
    """
    readings = [taken.reading for taken in own]
    first, name = readings[0], readings[0].experiment
    _check_one_experiment(readings, source)
    volts = np.array([r.reading_v for r in readings])
    torque = np.array([r.torque_nm for r in readings])
    fit = _fit_line(name, volts, torque, source)
    gain, intercept = fit.quantity(0), fit.quantity(1)
    steps = _steps(readings, gain.value, float(fit.coefficients[1]))
    widths = [abs(s.hysteresis_v * gain.value) for s in steps if s.hysteresis_v is not None]
    line = ExperimentLine(
        id=name,
        position_rad=first.position_rad,
        direction=first.direction,
        range=first.range,
        gain_nm_per_v=gain.value,
        gain_std_nm_per_v=gain.std,
        gain_dof=gain.dof,
        intercept_nm=intercept.value,
        intercept_std_nm=intercept.std,
        zero_v=-float(fit.coefficients[1]) / gain.value,
        residual_rms_nm=fit.rms,
        hysteresis_nm=max(widths) if widths else None,
        n=len(readings),
        doubtful=tuple(own[i].index for i in _doubtful(volts, fit.residual)),
    )
    return line, steps


def _fit_line(name: str, volts: FloatArray, torque: FloatArray, source: str) -> LinearFit:
    """Return the regression of torque on volts and one, or say why there is none."""
    where = f"{source}: experiment {name}"
    if not (np.all(np.abs(volts) < _LARGEST) and np.all(np.abs(torque) < _LARGEST)):
        raise DataError(
            f"experiment {name} holds a reading or torque that is not finite, or not below "
            f"{_LARGEST:g}",
            where=where,
            fix="remove or repeat that reading",
        )
    try:
        fit = ordinary_fit(np.column_stack([volts, np.ones(len(volts))]), torque)
    except ValueError as error:
        raise DataError(
            f"no line fits experiment {name}: {error}; needed: at least 3 readings at 2 or more "
            f"distinct voltages, found {len(volts)} readings",
            where=where,
            fix="record at least three loads in this experiment",
        ) from error
    if fit.coefficients[0] == 0.0:
        raise DataError(
            f"the readings of experiment {name} do not change with torque",
            where=where,
            fix="check bridge, amplifier and the mapping of the columns",
        )
    return fit


def _check_one_experiment(readings: Sequence[LoadReading], source: str) -> None:
    name, places = readings[0].experiment, [readings[0].position_rad]
    same_place = not any(position_number(r.position_rad, places) for r in readings)
    for key in ("position_rad", "direction", "range"):
        values = sorted({str(getattr(r, key)) for r in readings})
        if len(values) > 1 and not (key == "position_rad" and same_place):
            raise DataError(
                f"experiment {name} holds {len(values)} values of {key}: {', '.join(values)}; "
                "needed: one, because one line is fitted to it",
                where=f"{source}: experiment {name}, column {key}",
                fix="give each position, direction and range an experiment of its own",
            )


def _doubtful(volts: FloatArray, residual: FloatArray) -> list[int]:
    """Return the indices whose externally studentised residual is beyond chance."""
    n = len(volts)
    free = n - 3
    if free < 1:
        return []
    from scipy.special import stdtrit

    offset = volts - volts.mean()
    leverage = 1.0 / n + offset**2 / float(offset @ offset)
    total = float(residual @ residual)
    # a point that alone fixes the line has leverage 1 and no residual to judge
    open_ = np.maximum(1.0 - leverage, 1e-9)
    others = (total - residual**2 / open_) / free
    limit = float(stdtrit(free, 1.0 - _DOUBT_LEVEL / (2.0 * n)))
    # residuals at rounding level of the torque say nothing about a reading
    floor = 1e-12 * max(1.0, total)
    return [
        i for i in range(n) if residual[i] ** 2 / open_[i] > limit**2 * max(float(others[i]), floor)
    ]


def _steps(
    readings: Sequence[LoadReading], gain: float, intercept: float
) -> tuple[ExperimentStep, ...]:
    """Return the steps of one experiment, by applied torque."""
    largest = max(abs(r.torque_nm) for r in readings)
    groups: list[list[LoadReading]] = []
    for reading in sorted(readings, key=lambda r: r.torque_nm):
        last = groups[-1][0].torque_nm if groups else math.inf
        if groups and abs(reading.torque_nm - last) <= _STEP_SHARE * largest:
            groups[-1].append(reading)
        else:
            groups.append([reading])
    return tuple(_step(group, gain, intercept) for group in groups)


def _step(group: list[LoadReading], gain: float, intercept: float) -> ExperimentStep:
    def mean(series: str) -> float | None:
        values = [r.reading_v for r in group if r.series == series]
        return math.fsum(values) / len(values) if values else None

    up, down = mean("up"), mean("down")
    reading = math.fsum(r.reading_v for r in group) / len(group)
    return ExperimentStep(
        experiment=group[0].experiment,
        torque_nm=group[0].torque_nm,
        reading_up_v=up,
        reading_down_v=down,
        hysteresis_v=None if up is None or down is None else down - up,
        deviation_nm=group[0].torque_nm - (gain * reading + intercept),
    )


# torques below this share of the largest of an experiment, or of a group of them, are its zero: a
# hand-read reference shows as much
ZERO_SHARE = 0.005


def loading_loops(
    readings: Sequence[TakenReading], lines: tuple[ExperimentLine, ...]
) -> dict[str, Loop]:
    """Return the loop of each experiment that was loaded and unloaded."""
    found: dict[str, Loop] = {}
    for line in lines:
        own = [t.reading for t in readings if t.reading.experiment == line.id]
        torque = np.array([abs(r.torque_nm) for r in own])
        volts, up = np.array([r.reading_v for r in own]), np.array([r.series == "up" for r in own])
        # anticlockwise torques are counted as positive too: so is then the gain
        sign = 1.0 if line.direction == "cw" else -1.0
        loop = loading_loop(
            (torque[up], volts[up]),
            (torque[~up], volts[~up]),
            sign * line.gain_nm_per_v,
            ZERO_SHARE * float(torque.max()),
        )
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
