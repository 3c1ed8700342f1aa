"""The line of one loading experiment, and the readings that stand off it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdbench.calibration.steps import LoadStep, load_steps
from hdbench.errors import DataError
from hdbench.estimation.regression import LinearFit, ordinary_fit
from hdbench.records.loads import LoadReading
from hdbench.records.quantity import Quantity
from hdbench.records.trace import FloatArray

__all__ = ["POSITION_RAD", "ExperimentLine", "fit_experiment"]

# positions closer than this are one position: a sixth of a tooth of 200, above what an encoder at
# the output or a mark made by hand repeats
POSITION_RAD = 5e-3

# chance that one experiment without a bad reading shows a doubtful one
_DOUBT_LEVEL = 0.05
# squares of larger numbers leave the range of a double; no torque or voltage comes near
_LARGEST = 1e100


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
    fit = _fit_line(name, volts, torque, source)
    gain = fit.quantity(0)
    steps = load_steps([r for _, r in readings], gain.value, fit.coefficients[1])
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
            abs(math.remainder(r.position_rad - first, 2.0 * math.pi)) < POSITION_RAD
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
