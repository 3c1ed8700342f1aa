"""The calibration record as a table for a spreadsheet: steps, budget, decision, readings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

from hdbench.records.csvtext import csv_text
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
