"""Calibration by the report's method: a line per experiment, mean gain, consistency."""

from __future__ import annotations

import numpy as np

from hdbench.calibration.lines import ExperimentLine, fit_experiment
from hdbench.calibration.result import CalibrationResult
from hdbench.calibration.statistics import consistency_interval, mean_gain, shared_dof
from hdbench.errors import DataError
from hdbench.estimation.channel import DataFlag
from hdbench.records.loads import LoadReading, Loads

__all__ = ["evaluate_calibration"]


def evaluate_calibration(loads: Loads, *, max_consistency: float) -> CalibrationResult:
    """Evaluate static readings as the report does.

    Parameters
    ----------
    loads : Loads
        Readings of one or more loading experiments.
    max_consistency : float
        Largest consistency that is accepted, dimensionless, above 0.

    Returns
    -------
    CalibrationResult

    Raises
    ------
    DataError
        If there are no readings, or an experiment allows no line.

    Notes
    -----
    Line per experiment: torque on voltage, with intercept, loading and unloading together,
    ordinary least squares. Gain: plain mean of the slopes. Consistency: their standard deviation
    (ddof 1) over their mean.

    References
    ----------
    .. [1] H. D. Taghirad, CIM-TR-97-06, McGill University, 1997, section 3 and table 1.
    """
    groups: dict[str, list[tuple[int, LoadReading]]] = {}
    for index, reading in enumerate(loads.readings):
        groups.setdefault(reading.experiment, []).append((index, reading))
    if not groups:
        raise DataError(
            "found 0 readings; needed: at least one experiment of 3 readings",
            where=loads.source,
            fix="give a loads file with readings",
        )
    lines = tuple(
        fit_experiment(name, group, source=loads.source) for name, group in groups.items()
    )
    gain, basis, reason = mean_gain(lines)
    if gain.value == 0.0:
        raise DataError(
            "the gains of the experiments cancel: their mean is 0 N m/V; needed: one sign",
            where=loads.source,
            fix="give torques their sign: cw positive, ccw negative",
        )
    consistency = interval = by_positions = accepted = None
    if len(lines) > 1:
        gains = np.array([line.gain_nm_per_v.value for line in lines])
        consistency = float(np.std(gains, ddof=1)) / abs(gain.value)
        interval = consistency_interval(consistency, len(lines) - 1)
        by_positions = consistency_interval(consistency, shared_dof(lines))
        accepted = bool(consistency <= max_consistency)
    return CalibrationResult(
        gain_nm_per_v=gain,
        gain_basis=basis,
        gain_basis_reason=reason,
        consistency=consistency,
        consistency_interval=interval,
        consistency_interval_positions=by_positions,
        max_consistency=max_consistency,
        accepted=accepted,
        experiments=lines,
        flags=(),
        notes=_notes(lines, basis, reason),
        n_samples=len(loads),
    )


def _notes(lines: tuple[ExperimentLine, ...], basis: str, reason: str) -> tuple[DataFlag, ...]:
    notes = []
    n_doubtful = sum(len(line.doubtful) for line in lines)
    if n_doubtful:
        names = ", ".join(line.id for line in lines if line.doubtful)
        detail = f"{n_doubtful} readings stand off the line of experiment {names}; kept in the fit"
        notes.append(DataFlag("doubtful-readings", n_doubtful, detail))
    if basis != "positions":
        notes.append(DataFlag(f"gain-{basis}", sum(line.n for line in lines), reason))
    return tuple(notes)
