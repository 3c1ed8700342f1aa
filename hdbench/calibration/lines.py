"""The line of one loading experiment, and the readings that stand off it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.errors import DataError
from hdbench.estimation.regression import ordinary_fit
from hdbench.records.loads import LoadReading
from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray

__all__ = ["ExperimentLine", "LoadStep", "fit_experiment"]

# chance that one experiment without a bad reading shows a doubtful one
_DOUBT_LEVEL = 0.05
# torques of one load step differ by less than this share of the largest torque
_STEP_SHARE = 1e-6


@dataclass(frozen=True, slots=True)
class LoadStep:
    """Readings of one experiment under one applied torque.

    Parameters
    ----------
    torque_nm : float
        Applied torque, N m.
    reading_up_v, reading_down_v : float or None
        Mean reading while loading and while unloading, V; None where there is none.
    hysteresis_v : float or None
        Unloading minus loading, V.
    deviation_nm : float
        Applied torque minus the experiment's line at the mean reading, N m.
    """

    torque_nm: float
    reading_up_v: float | None
    reading_down_v: float | None
    hysteresis_v: float | None
    deviation_nm: float

    def to_dict(self) -> dict[str, float | None]:
        """Return the step as results store it."""
        return {
            "torque_nm": self.torque_nm,
            "reading_up_v": self.reading_up_v,
            "reading_down_v": self.reading_down_v,
            "hysteresis_v": self.hysteresis_v,
            "deviation_nm": self.deviation_nm,
        }


@dataclass(frozen=True, slots=True)
class ExperimentLine:
    """Torque on voltage for one loading experiment.

    Parameters
    ----------
    id : str
        Identifier of the experiment.
    position_rad : float
        Flexspline position, rad.
    direction, range : str
        ``cw`` or ``ccw``; ``low`` or ``full``.
    gain_nm_per_v : Quantity
        Slope, N m/V.
    intercept_nm : Quantity
        Torque at zero volts, N m.
    zero_v : float
        Reading at zero torque by the line, V.
    residual_rms_nm : float
        Root mean square of the residuals, N m.
    hysteresis_nm : float or None
        Largest difference of unloading and loading at one step, N m.
    n : int
        Readings.
    doubtful : tuple of int
        Indices, in the loads, of readings that stand off the line; marked, not removed.
    steps : tuple of LoadStep
        Mean readings per load.
    """

    id: str
    position_rad: float
    direction: str
    range: str
    gain_nm_per_v: Quantity
    intercept_nm: Quantity
    zero_v: float
    residual_rms_nm: float
    hysteresis_nm: float | None
    n: int
    doubtful: tuple[int, ...]
    steps: tuple[LoadStep, ...]

    def to_dict(self) -> dict[str, object]:
        """Return the line as results store it; the gain is a plain number, its std beside it."""
        return {
            "id": self.id,
            "position_rad": self.position_rad,
            "direction": self.direction,
            "range": self.range,
            "gain_nm_per_v": self.gain_nm_per_v.value,
            "gain_std_nm_per_v": self.gain_nm_per_v.std,
            "gain_dof": self.gain_nm_per_v.dof,
            "intercept_nm": self.intercept_nm.value,
            "intercept_std_nm": self.intercept_nm.std,
            "zero_v": self.zero_v,
            "residual_rms_nm": self.residual_rms_nm,
            "hysteresis_nm": self.hysteresis_nm,
            "n": self.n,
            "doubtful": list(self.doubtful),
        }


def fit_experiment(
    name: str, readings: Sequence[tuple[int, LoadReading]], *, source: str
) -> ExperimentLine:
    """Fit the line of one loading experiment.

    Parameters
    ----------
    name : str
        Identifier of the experiment.
    readings : sequence of (int, LoadReading)
        Its readings with their index in the loads; loading and unloading together.
    source : str
        Where they came from, for messages.

    Returns
    -------
    ExperimentLine

    Raises
    ------
    DataError
        If fewer than three readings or fewer than two distinct voltages are there, if a number
        is not finite, or if one experiment holds several positions, directions or ranges.

    Notes
    -----
    ``torque = gain * reading + intercept``, ordinary least squares of torque on voltage, as in
    CIM-TR-97-06 section 3. A reading is doubtful where its externally studentised residual
    exceeds Student's t at 0.05 / (2 n): one experiment in twenty shows one by chance.
    """
    _check_one_experiment(name, readings, source)
    volts = np.array([r.reading_v for _, r in readings])
    torque = np.array([r.torque_nm for _, r in readings])
    if not (np.isfinite(volts).all() and np.isfinite(torque).all()):
        raise DataError(
            f"experiment {name} holds a reading or torque that is not finite",
            where=f"{source}: experiment {name}",
            fix="remove or repeat that reading",
        )
    try:
        fit = ordinary_fit(np.column_stack([volts, np.ones(len(volts))]), torque)
    except ValueError as error:
        raise DataError(
            f"no line fits experiment {name}: {error}; needed: at least 3 readings at 2 or more "
            f"distinct voltages, found {len(volts)} readings",
            where=f"{source}: experiment {name}",
            fix="record at least three loads in this experiment",
        ) from error
    gain = fit.quantity(0)
    if gain.value == 0.0:
        raise DataError(
            f"the readings of experiment {name} do not change with torque",
            where=f"{source}: experiment {name}",
            fix="check bridge, amplifier and the mapping of the columns",
        )
    steps = _load_steps(readings, gain.value, fit.coefficients[1])
    widths = [abs(s.hysteresis_v * gain.value) for s in steps if s.hysteresis_v is not None]
    first = readings[0][1]
    return ExperimentLine(
        id=name,
        position_rad=first.position_rad,
        direction=first.direction,
        range=first.range,
        gain_nm_per_v=gain,
        intercept_nm=fit.quantity(1),
        zero_v=-float(fit.coefficients[1]) / gain.value,
        residual_rms_nm=fit.rms,
        hysteresis_nm=max(widths) if widths else None,
        n=len(readings),
        doubtful=tuple(readings[i][0] for i in _doubtful(volts, fit.residual)),
        steps=steps,
    )


def _check_one_experiment(
    name: str, readings: Sequence[tuple[int, LoadReading]], source: str
) -> None:
    for key in ("position_rad", "direction", "range"):
        values = sorted({str(getattr(r, key)) for _, r in readings})
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


def _load_steps(
    readings: Sequence[tuple[int, LoadReading]], gain: float, intercept: float
) -> tuple[LoadStep, ...]:
    largest = max(abs(r.torque_nm) for _, r in readings)
    groups: list[list[LoadReading]] = []
    for _, reading in sorted(readings, key=lambda item: item[1].torque_nm):
        last = groups[-1][0].torque_nm if groups else math.inf
        if groups and abs(reading.torque_nm - last) <= _STEP_SHARE * largest:
            groups[-1].append(reading)
        else:
            groups.append([reading])
    return tuple(_load_step(group, gain, intercept) for group in groups)


def _load_step(group: list[LoadReading], gain: float, intercept: float) -> LoadStep:
    def mean(series: str) -> float | None:
        values = [r.reading_v for r in group if r.series == series]
        return math.fsum(values) / len(values) if values else None

    up, down = mean("up"), mean("down")
    reading = math.fsum(r.reading_v for r in group) / len(group)
    return LoadStep(
        torque_nm=group[0].torque_nm,
        reading_up_v=up,
        reading_down_v=down,
        hysteresis_v=None if up is None or down is None else down - up,
        deviation_nm=group[0].torque_nm - (gain * reading + intercept),
    )
