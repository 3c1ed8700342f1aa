"""Calibration in a report: verdict, key numbers, figures, tables, and the record as CSV."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace

from hdbench.records import Loads
from hdbench.records.csvtext import csv_text
from hdbench.report.calibration.figures import range_pictures, record_pictures
from hdbench.report.calibration.tables import tables as tables
from hdbench.report.numbers import with_std
from hdbench.report.pagemodel import KeyNumber, Picture, Verdict
from hdbench.report.source import Source
from hdbench.results import CalibrationResult
from hdbench.results.calibration import LoadStep

_HEAD = ("part", "group", "torque_nm", "name", "value", "unit")
# keys with their units
_GAIN = {"value": "N m/V", "std": "N m/V", "dof": "1", "coverage_factor": "1", "expanded": "N m/V"}
_LINE = {
    "gain_nm_per_v": "N m/V",
    "gain_std_nm_per_v": "N m/V",
    "intercept_nm": "N m",
    "residual_rms_nm": "N m",
}
_STEP = tuple(entry.name for entry in fields(LoadStep) if entry.name.endswith("_v"))
_CASE = {
    "relative_std": "1",
    "dof": "1",
    "coverage_factor": "1",
    "expanded_relative_k2_with_deviation": "1",
    "expanded_relative_with_deviation": "1",
    "expanded_nm": "N m",
}
Row = tuple[str, str, object, str, object, str]


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


def record_csv(result: CalibrationResult) -> str:
    """Return the calibration record as text with commas."""
    return csv_text(_HEAD, (row for row in _rows(result) if row[4] is not None))


def _rows(result: CalibrationResult) -> Iterator[Row]:
    for name in ("mean_of_positions", "any_one_position", "naive"):
        gain = getattr(result.uncertainty, name, None)
        if gain is not None:
            yield from (
                ("gain", name, None, key, getattr(gain, key), u) for key, u in _GAIN.items()
            )
    yield "gain", "experiments", None, "consistency", result.consistency, "1"
    for end, limit in zip(("low", "high"), result.consistency_interval or (), strict=False):
        yield "gain", "experiments", None, f"consistency_{end}", limit, "1"
    yield "class", "indicative", None, "class", result.grade, "1"
    for test in result.acceptance.tests if result.acceptance else ():
        yield "acceptance", "limits", None, test.name, str(test.passed), ""
    for line in result.experiments:
        for key, unit in _LINE.items():
            yield "experiment", str(line.id), None, key, getattr(line, key), unit
    for step in result.steps:
        group, torque = f"{step.direction} {step.range}", step.torque_nm
        yield from (("step", group, torque, key, getattr(step, key), "V") for key in _STEP)
        for case in ("increasing", "increasing_decreasing"):
            for key, unit in _CASE.items():
                value = getattr(getattr(step, case), key, None)
                yield "step", group, torque, f"{case}.{key}", value, unit
    for row in result.budget:
        size = row.relative_std if row.declared else "not declared"
        yield "budget", row.group, None, row.name, size, "1"
    for part in result.torque.corrections if result.torque else ():
        told = part.relative if part.made else "not made"
        yield "correction", "applied torque", None, part.name, told, "1"
    for r in result.readings:
        group = f"{r.experiment} {r.series}"
        yield r.kind, group, r.torque_nm, "reading_v", r.reading_v, "V"
