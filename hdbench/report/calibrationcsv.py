"""The calibration record as a table for a spreadsheet: steps, budget, decision, readings."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from typing import Any

__all__ = ["record_csv"]

_HEAD = ("part", "group", "torque_nm", "name", "value", "unit")
_STEP_NAMES = (
    ("deflection_v", "V"),
    ("deflection_up_down_v", "V"),
    ("fitted_v", "V"),
    ("repeatability_v", "V"),
    ("reproducibility_v", "V"),
    ("range_v", "V"),
    ("reversibility_v", "V"),
    ("deviation_linear_v", "V"),
    ("deviation_cubic_v", "V"),
)
_CASE_NAMES = (
    ("relative_std", "1"),
    ("dof", "1"),
    ("coverage_factor", "1"),
    ("expanded_relative_k2_with_deviation", "1"),
    ("expanded_relative_with_deviation", "1"),
    ("expanded_nm", "N m"),
)

Row = tuple[str, str, object, str, object, str]


def record_csv(result: Mapping[str, Any]) -> str:
    """Return the calibration record as text with commas."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_HEAD)
    for part, group, torque, name, value, unit in _rows(result):
        if value is not None:
            shown = repr(value) if isinstance(value, float) else value
            at = "" if torque is None else repr(torque)
            writer.writerow((part, group, at, name, shown, unit))
    return text.getvalue()


def _rows(result: Mapping[str, Any]) -> Iterator[Row]:
    yield from _gain(result)
    for line in result.get("experiments", ()):
        for name, unit in (
            ("gain_nm_per_v", "N m/V"),
            ("gain_std_nm_per_v", "N m/V"),
            ("intercept_nm", "N m"),
            ("residual_rms_nm", "N m"),
        ):
            yield "experiment", str(line["id"]), None, name, line.get(name), unit
    for step in result.get("steps", ()):
        yield from _step(step)
    for row in result.get("budget", ()):
        size = row["relative_std"] if row["declared"] else "not declared"
        yield "budget", row["group"], None, row["name"], size, "1"
    for row in result.get("torque", {}).get("corrections", ()):
        size = row["relative"] if row["made"] else "not made"
        yield "correction", "applied torque", None, row["name"], size, "1"
    for r in result.get("readings", ()):
        group = f"{r['experiment']} {r['series']}"
        yield r["kind"], group, r["torque_nm"], "reading_v", r["reading_v"], "V"


def _gain(result: Mapping[str, Any]) -> Iterator[Row]:
    for name, body in result.get("uncertainty", {}).items():
        if isinstance(body, Mapping):
            for key, unit in (
                ("value", "N m/V"),
                ("std", "N m/V"),
                ("dof", "1"),
                ("coverage_factor", "1"),
                ("expanded", "N m/V"),
            ):
                yield "gain", name, None, key, body.get(key), unit
    yield "gain", "experiments", None, "consistency", result.get("consistency"), "1"
    for end, value in zip(("low", "high"), result.get("consistency_interval") or (), strict=False):
        yield "gain", "experiments", None, f"consistency_{end}", value, "1"
    yield "class", "indicative", None, "class", result.get("class"), "1"
    for test in result.get("acceptance", {}).get("tests", ()):
        yield "acceptance", "limits", None, test["name"], str(test["passed"]), ""


def _step(step: Mapping[str, Any]) -> Iterator[Row]:
    group, torque = f"{step['direction']} {step['range']}", step["torque_nm"]
    for name, unit in _STEP_NAMES:
        yield "step", group, torque, name, step[name], unit
    for case in ("increasing", "increasing_decreasing"):
        for name, unit in _CASE_NAMES:
            body = step[case] or {}
            yield "step", group, torque, f"{case}.{name}", body.get(name), unit
