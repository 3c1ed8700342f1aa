"""Calibration by the report's method, and the metrological evaluation beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hdbench.calibration import budget, differences
from hdbench.calibration.course import (
    course_of,
    doubts_of,
    notes_of,
    sequence_deviations,
    shunt_record,
)
from hdbench.calibration.gains import (
    by_position,
    consistency_interval,
    gain_outliers,
    mean_gain,
    mixed_fit,
    one_way,
    position_numbers,
    shared_dof,
    vangel_interval,
)
from hdbench.calibration.lever import TorqueAccount, apply_torque, with_shares
from hdbench.calibration.lines import fit_experiment, loading_loops
from hdbench.calibration.readings import TakenReading, reading_resolution, taken_readings
from hdbench.calibration.stepwise.evaluation import CLASSES, evaluate_group, overall_class
from hdbench.calibration.stepwise.series import odd_readings, step_groups
from hdbench.errors import DataError
from hdbench.profile.calibrating import AcceptanceLimits
from hdbench.profile.schema import ProfileData
from hdbench.records.loads import Loads
from hdbench.records.quantity import Quantity
from hdbench.results import calibration as record

# stands for a class that is worse than the worst: the next of the series
_WORSE = 2.0 * CLASSES[-1]
_RULES = {
    "simple": "simple acceptance: a value is accepted when it is at most its limit, whatever its "
    "uncertainty",
    "guarded": "guarded acceptance: the upper end of the 95 % interval of a value has to be at "
    "most its limit, where the value has an interval",
}


def decide(tests: Sequence[record.LimitTest], rule: str) -> tuple[bool | None, record.Acceptance]:
    """Decide by all tests: None where none is broken and one could not be tested."""
    told = tuple(replace(test, passed=_passed(test, rule)) for test in tests)
    held = [test.passed for test in told]
    accepted = False if False in held else None if None in held else True
    return accepted, record.Acceptance(decision_rule=rule, statement=_RULES[rule], tests=told)


def _passed(test: record.LimitTest, rule: str) -> bool | None:
    if test.value is None:
        return None
    tested = test.upper if rule == "guarded" and test.upper is not None else test.value
    return bool(tested <= test.limit)


def limit_tests(
    expanded: float,
    groups: Sequence[record.LoadGroup],
    loops: Sequence[record.Loop],
    direction: record.PairedDifference | None,
    limits: AcceptanceLimits,
) -> list[record.LimitTest]:
    """Return every value that has a limit beside the consistency."""
    zeros = [abs(x.zero_return_relative) for x in loops if x.zero_return_relative is not None]
    bends = [x.lack_of_fit.relative for x in groups if x.lack_of_fit is not None]
    apart = upper = None
    if direction is not None:
        relative = direction.relative
        apart = abs(relative.value)
        upper = apart + budget.expanded_uncertainty(relative.std, relative.dof).expanded
    rows = (
        ("expanded-uncertainty", expanded, limits.max_expanded_uncertainty, None),
        ("class", _grade(groups), limits.max_class, None),
        ("zero-return", max(zeros, default=None), limits.max_zero_return, None),
        ("hysteresis", max((x.relative for x in loops), default=None), limits.max_hysteresis, None),
        ("lack-of-fit", max(bends, default=None), limits.max_lack_of_fit, None),
        ("direction-asymmetry", apart, limits.max_direction_asymmetry, upper),
    )
    return [
        record.LimitTest(name=name, value=value, limit=limit, upper=upper)
        for name, value, limit, upper in rows
        if limit is not None
    ]


def _grade(groups: Sequence[record.LoadGroup]) -> float | None:
    grade = overall_class(groups)
    if grade.value is None and any(c.allowed is None for c in grade.criteria):
        return _WORSE
    return grade.value


# an uncertainty below this share of the gain is rounding: trials cannot show it
_ROUNDING = 1e-12
_METHOD = "in the manner of EURAMET cg-14, indicative, not checked against its text"


def evaluate_calibration(
    loads: Loads,
    *,
    max_consistency: float,
    bench: ProfileData | None = None,
    monte_carlo_seed: int | None = None,
) -> record.CalibrationResult:
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
    lines, steps = _lines(readings, loads.source)
    scatter, basis, reason = mean_gain(lines)
    _check_sign(scatter.value, loads.source)
    value, gains, places = scatter.value, [x.gain_nm_per_v for x in lines], position_numbers(lines)
    rows = budget.gain_rows(scatter, lines, account.rows, bench)
    mean = budget.expanded_of(value, rows)
    positions = one_way([[x.gain_nm_per_v for x in group] for group in by_position(lines)])
    grouped = step_groups(readings, "single" if bench is None else bench.arm.loading)
    resolution = reading_resolution(readings, bench)
    groups = [evaluate_group(group, account, resolution) for group in grouped]
    grade = overall_class([group for group, _ in groups])
    loops, direction = loading_loops(readings, lines), _paired(lines, places, "cw", "ccw")
    spread = _consistency(lines, value)
    rule, tests = "simple", [_consistency_test(spread, max_consistency)]
    if bench is not None:
        limits, rule = bench.calibration.limits, bench.calibration.limits.decision_rule
        expanded, summaries = mean.expanded / abs(value), [group for group, _ in groups]
        tests += limit_tests(expanded, summaries, list(loops.values()), direction, limits)
    accepted, acceptance = decide(tests, rule)
    monte_carlo = None
    if monte_carlo_seed is not None and mean.std > _ROUNDING * abs(value):
        monte_carlo = budget.propagate(
            value, rows, (mean.std, mean.expanded), seed=monte_carlo_seed
        )
    sequence = tuple(loads.metadata.get("sequence", ()))
    course = course_of(everything, sequence)
    shunt = None if bench is None else bench.calibration.shunt
    return record.CalibrationResult(
        gain_nm_per_v=Quantity(value, mean.std, mean.dof),
        gain_basis=basis,
        gain_basis_reason=reason,
        **spread,
        max_consistency=max_consistency,
        n_experiments=len(lines),
        accepted=accepted,
        acceptance=acceptance,
        experiments=lines,
        method=_METHOD,
        steps=tuple(step for _, own in groups for step in own),
        grade=grade.value,
        class_reason=f"{_METHOD}; {grade.reason}",
        groups=tuple(group for group, _ in groups),
        uncertainty=record.GainUncertainty(
            mean_of_positions=budget.expanded_gain(value, mean),
            any_one_position=budget.expanded_gain(
                value, budget.expanded_any_one(value, positions, lines, rows)
            ),
            naive=budget.expanded_gain(value, budget.expanded_naive(gains)),
        ),
        positions=positions,
        mixed_model=mixed_fit(gains, places, [(x.direction, x.range) for x in lines]),
        direction=direction,
        direction_effects=differences.direction_effects(
            differences.direction_entries(readings, lines, bench)
        ),
        ranges=_paired(lines, places, "low", "full"),
        consensus=differences.consensus(gains, [x.gain_std_nm_per_v or 0.0 for x in lines]),
        hysteresis=loops,
        outliers=(
            *gain_outliers(lines),
            *(reading for group in grouped for reading in odd_readings(group)),
        ),
        torque=account.record(),
        side_force=differences.side_force(
            account.largest, direction, None if bench is None else bench.arm
        ),
        budget=with_shares(rows),
        experiment_steps=steps,
        monte_carlo=monte_carlo,
        course=course,
        shunt=shunt_record(everything, sequence, shunt, value),
        deviations=sequence_deviations(groups, course.n_preloads),
        **_declared(bench),
        sequence=sequence,
        readings=tuple(taken.record() for taken in everything),
        flags=doubts_of(lines),
        notes=notes_of(lines, everything, account, (basis, reason)),
        n_samples=len(readings),
    )


def _check_sign(gain: float, source: str) -> None:
    if gain == 0.0:
        raise DataError(
            "the gains of the experiments cancel: their mean is 0 N m/V; needed: one sign",
            where=source,
            fix="give torques their sign: cw positive, ccw negative",
        )


def _lines(
    readings: Sequence[TakenReading], source: str
) -> tuple[tuple[record.ExperimentLine, ...], tuple[record.ExperimentStep, ...]]:
    """Return the line of each experiment, and the steps of all."""
    groups: dict[str, list[TakenReading]] = {}
    for taken in readings:
        groups.setdefault(taken.reading.experiment, []).append(taken)
    if not groups:
        raise DataError(
            "found 0 readings; needed: at least one experiment of 3 readings",
            where=source,
            fix="give a loads file with readings",
        )
    found = [fit_experiment(group, source) for group in groups.values()]
    return tuple(line for line, _ in found), tuple(step for _, own in found for step in own)


def _consistency(lines: tuple[record.ExperimentLine, ...], gain: float) -> dict[str, Any]:
    """Return the consistency and its intervals; None for one experiment."""
    if len(lines) < 2:
        return {"consistency": None}
    gains = np.array([line.gain_nm_per_v for line in lines])
    consistency, dof = float(np.std(gains, ddof=1)) / abs(gain), len(lines) - 1
    return {
        "consistency": consistency,
        "consistency_interval": consistency_interval(consistency, dof),
        "consistency_interval_positions": consistency_interval(consistency, shared_dof(lines)),
        "consistency_interval_vangel": vangel_interval(consistency, dof),
    }


def _consistency_test(spread: dict[str, Any], limit: float) -> record.LimitTest:
    interval = spread.get("consistency_interval")
    return record.LimitTest(
        name="consistency",
        value=spread["consistency"],
        limit=limit,
        upper=None if interval is None else interval[1],
    )


def _paired(
    lines: tuple[record.ExperimentLine, ...], places: Sequence[int], first: str, second: str
) -> record.PairedDifference | None:
    """Compare directions or ranges over the pairs that share position and the other of both."""
    entries = []
    for place, line in zip(places, lines, strict=True):
        shared, level = line.range, line.direction
        if first == "low":
            shared, level = level, shared
        entries.append(((place, shared), level, line.gain_nm_per_v))
    return differences.paired_difference(entries, first, second)


def _declared(bench: ProfileData | None) -> dict[str, Any]:
    """Return what the profile declares: standards, identity, arm, validity."""
    if bench is None:
        return {}
    item = {**dict(bench.sensor), **dict(bench.drive), **dict(bench.identity)}
    return {
        "standards": record.StandardsRecord.from_json(bench.standards.model_dump(), "standards"),
        "identity": record.IdentityRecord.from_json(item, "identity"),
        "arm": record.ArmRecord(**bench.arm.model_dump()),
        "validity_days": bench.calibration.validity_days,
        "average_s": bench.calibration.average_s,
    }
