"""The line of one loading experiment, and the readings that stand off it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hdbench.errors import DataError
from hdbench.estimation.regression import LinearFit, ordinary_fit
from hdbench.records.loads import LoadReading
from hdbench.records.trace import FloatArray
from hdbench.results.calibration import ExperimentLine, ExperimentStep

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
    name: str, readings: Sequence[tuple[int, LoadReading]], *, source: str
) -> tuple[ExperimentLine, tuple[ExperimentStep, ...]]:
    """Fit the line of one loading experiment.

    Notes
    -----
    ``torque = gain * reading + intercept``, ordinary least squares of torque on voltage, as in
    CIM-TR-97-06 section 3. A reading is doubtful where its externally studentised residual
    exceeds Student's t at 0.05 / (2 n): one experiment in twenty shows one by chance.
    """
    _check_one_experiment(name, readings, source)
    volts = np.array([r.reading_v for _, r in readings])
    torque = np.array([r.torque_nm for _, r in readings])
    fit = _fit_line(name, volts, torque, source)
    gain, intercept = fit.quantity(0), fit.quantity(1)
    steps = _steps([r for _, r in readings], gain.value, float(fit.coefficients[1]))
    widths = [abs(s.hysteresis_v * gain.value) for s in steps if s.hysteresis_v is not None]
    first = readings[0][1]
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
        doubtful=tuple(readings[i][0] for i in _doubtful(volts, fit.residual)),
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


def _check_one_experiment(
    name: str, readings: Sequence[tuple[int, LoadReading]], source: str
) -> None:
    first = readings[0][1].position_rad
    for key in ("position_rad", "direction", "range"):
        values = sorted({str(getattr(r, key)) for _, r in readings})
        if key == "position_rad" and all(
            abs(math.remainder(r.position_rad - first, 2.0 * math.pi)) < _POSITION_RAD
            for _, r in readings
        ):
            continue
        if len(values) > 1:
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
