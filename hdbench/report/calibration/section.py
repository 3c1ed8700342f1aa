"""Calibration in a report: verdict, summary, key numbers, figures, tables and the record."""

from __future__ import annotations

from dataclasses import replace

from hdbench.records import Loads
from hdbench.report.calibration.figures import range_pictures, record_pictures
from hdbench.report.calibration.tables import tables as tables
from hdbench.report.numbers import with_std
from hdbench.report.pagemodel import KeyNumber, Picture, Verdict
from hdbench.report.source import Source
from hdbench.results import CalibrationResult


def verdict(result: CalibrationResult) -> Verdict:
    """Say whether the gain is accepted."""
    consistency, limit = result.consistency, result.max_consistency
    gain = with_std(result.gain_nm_per_v)
    if result.accepted is None or consistency is None:
        return Verdict("look", f"Gain {gain} N·m/V from one experiment: consistency unknown.")
    against = "" if limit is None else f" (limit {100 * limit:.1f} %)"
    words = f"gain {gain} N·m/V, consistency {100 * consistency:.2f} %{against}."
    if result.accepted:
        return Verdict("good", f"Calibration accepted: {words}")
    tests = result.acceptance.tests if result.acceptance else ()
    broken = [test.name for test in tests if test.passed is False]
    reason = f"; not held: {', '.join(broken)}" if broken else ""
    return Verdict("bad", f"Calibration not accepted: {words[:-1]}{reason}.")


def numbers(result: CalibrationResult, run_id: str) -> tuple[KeyNumber, ...]:
    """Return gain, consistency and size of the calibration."""
    one = result.uncertainty.any_one_position if result.uncertainty else None
    ends = result.consistency_interval
    within = f", 95 %: {ends[0]:.2g} to {ends[1]:.2g}" if ends else ""
    rows = (
        (result.gain_nm_per_v, "torque gain", "gain_nm_per_v", "N m/V"),
        (one, "torque gain, any one position", "uncertainty.any_one_position", "N m/V"),
        (result.consistency, f"consistency{within}", "consistency", ""),
        (result.n_experiments, "experiments", "n_experiments", ""),
        (result.grade, "class (indicative)", "class", ""),
    )
    return KeyNumber.rows(rows, run_id)


def pictures(source: Source, prefix: str, _doubts: list[str]) -> tuple[Picture, ...]:
    """Draw the figures of the record."""
    result: CalibrationResult = source.result
    return record_pictures(result, source.loads and _evaluated(source.loads, result), prefix)


def _evaluated(loads: Loads, result: CalibrationResult) -> Loads:
    """Return the readings that were evaluated, with the applied torque that was used."""
    if len(result.readings) != len(loads):
        return loads
    readings = tuple(
        replace(reading, torque_nm=told.torque_nm)
        for reading, told in zip(loads.readings, result.readings, strict=True)
        if told.kind == "reading"
    )
    return Loads(readings, loads.source)


def data_pictures(source: Source, prefix: str) -> tuple[Picture, ...]:
    """Draw readings that were not evaluated yet, with the line of each experiment."""
    from hdbench.calibration import evaluate_calibration

    if source.loads is None:
        return ()
    limit = 0.05 if source.profile is None else source.profile.data.calibration.max_consistency
    found = evaluate_calibration(source.loads, max_consistency=limit)
    return tuple(range_pictures(source.loads, found.experiments, prefix))
