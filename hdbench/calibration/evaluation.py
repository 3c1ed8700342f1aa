"""Calibration by the report's method: a line per experiment, mean gain, consistency."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdbench.calibration.acceptance import Acceptance, LimitTest, decide
from hdbench.calibration.limits import limit_tests
from hdbench.calibration.lines import ExperimentLine, fit_experiment
from hdbench.calibration.metrology import Metrology, evaluate_metrology
from hdbench.calibration.montecarlo import MonteCarlo, propagate
from hdbench.calibration.readings import TakenReading, taken_readings
from hdbench.calibration.remarks import doubts_of, notes_of
from hdbench.calibration.result import CalibrationResult
from hdbench.calibration.statistics import (
    consistency_interval,
    mean_gain,
    shared_dof,
    vangel_interval,
)
from hdbench.calibration.torque.applied import TorqueAccount, apply_torque
from hdbench.errors import DataError
from hdbench.profile.schema import ProfileData
from hdbench.records.loads import LoadReading, Loads
from hdbench.records.quantity import Quantity

__all__ = ["evaluate_calibration"]

# an uncertainty below this share of the gain is rounding: trials cannot show it
_ROUNDING = 1e-12

_Interval = tuple[float, float] | None
_Spread = tuple[float | None, _Interval, _Interval, tuple[float, float | None] | None]


def evaluate_calibration(
    loads: Loads,
    *,
    max_consistency: float,
    bench: ProfileData | None = None,
    monte_carlo_seed: int | None = None,
) -> CalibrationResult:
    """Evaluate static readings as the report does, and as a metrologist does beside it.

    Parameters
    ----------
    loads : Loads
        Readings of one or more loading experiments.
    max_consistency : float
        Largest consistency that is accepted, dimensionless, above 0.
    bench : ProfileData or None
        Arm, standards and limits; None: torques as they stand, nothing declared.
    monte_carlo_seed : int or None
        Seed of a Monte Carlo of a million trials beside the formula; None leaves it out.

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
    (ddof 1) over their mean. The uncertainty of the gain holds, beside the scatter of the position
    means, what the profile declares of the applied torque and of the instrument.

    References
    ----------
    .. [1] H. D. Taghirad, CIM-TR-97-06, McGill University, 1997, section 3 and table 1.
    """
    everything = taken_readings(loads)
    account = TorqueAccount("given", None, (), 0.0, "given", ())
    if bench is not None:
        everything, account = apply_torque(everything, bench)
    readings = tuple(t for t in everything if t.detail.kind == "reading")
    lines = _lines(readings, loads.source)
    scatter, basis, reason = mean_gain(lines)
    _check_sign(scatter.value, loads.source)
    found = evaluate_metrology(readings, lines, scatter, account, bench)
    gain = Quantity(scatter.value, found.mean.std, found.mean.dof)
    consistency, interval, shared, vangel = _consistency(lines, gain.value)
    return CalibrationResult(
        gain_nm_per_v=gain,
        gain_basis=basis,
        gain_basis_reason=reason,
        consistency=consistency,
        consistency_interval=interval,
        consistency_interval_positions=shared,
        consistency_interval_vangel=vangel,
        max_consistency=max_consistency,
        acceptance=_acceptance(found, gain.value, (consistency, interval, max_consistency), bench),
        experiments=lines,
        flags=doubts_of(lines),
        notes=notes_of(lines, everything, account, (basis, reason)),
        n_samples=len(readings),
        metrology=found,
        monte_carlo=_trials(gain, found, monte_carlo_seed),
        readings=everything,
        bench=bench,
        sequence=tuple(loads.metadata.get("sequence", ())),
    )


def _check_sign(gain: float, source: str) -> None:
    if gain == 0.0:
        raise DataError(
            "the gains of the experiments cancel: their mean is 0 N m/V; needed: one sign",
            where=source,
            fix="give torques their sign: cw positive, ccw negative",
        )


def _consistency(lines: tuple[ExperimentLine, ...], gain: float) -> _Spread:
    """Return the consistency and its intervals; None for one experiment."""
    if len(lines) < 2:
        return None, None, None, None
    gains = np.array([line.gain_nm_per_v.value for line in lines])
    consistency = float(np.std(gains, ddof=1)) / abs(gain)
    return (
        consistency,
        consistency_interval(consistency, len(lines) - 1),
        consistency_interval(consistency, shared_dof(lines)),
        vangel_interval(consistency, len(lines) - 1),
    )


def _lines(readings: Sequence[TakenReading], source: str) -> tuple[ExperimentLine, ...]:
    groups: dict[str, list[tuple[int, LoadReading]]] = {}
    for taken in readings:
        groups.setdefault(taken.reading.experiment, []).append((taken.index, taken.reading))
    if not groups:
        raise DataError(
            "found 0 readings; needed: at least one experiment of 3 readings",
            where=source,
            fix="give a loads file with readings",
        )
    return tuple(fit_experiment(name, group, source=source) for name, group in groups.items())


def _trials(gain: Quantity, found: Metrology, seed: int | None) -> MonteCarlo | None:
    if seed is None or not found.mean.std > _ROUNDING * abs(gain.value):
        return None
    formula = (found.mean.std, found.mean.expanded)
    return propagate(gain.value, found.rows, formula, seed=seed)


def _acceptance(
    found: Metrology,
    gain: float,
    consistency: tuple[float | None, tuple[float, float] | None, float],
    bench: ProfileData | None,
) -> Acceptance:
    limits = None if bench is None else bench.calibration.limits
    value, interval, limit = consistency
    upper = None if interval is None else interval[1]
    first = LimitTest("consistency", value, limit, upper)
    tests = limit_tests(found, gain, first, limits)
    return decide(tests, "simple" if limits is None else limits.decision_rule)
