"""Calibration in a report: verdict, summary, key numbers, figures, tables and the record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from hdbench.records import Loads
from hdbench.report.calibration.figures import range_pictures, record_pictures
from hdbench.report.calibration.tables import record_tables as tables
from hdbench.report.numbers import rounded_with, short, value_of, with_std
from hdbench.report.pagemodel import KeyNumber, Picture, Verdict, key_numbers
from hdbench.report.source import Source

__all__ = ["data_pictures", "numbers", "pictures", "summary", "tables", "verdict"]


def verdict(result: Mapping[str, Any]) -> Verdict:
    """Say whether the gain is accepted."""
    consistency, limit = value_of(result, "consistency"), value_of(result, "max_consistency")
    gain = with_std(result["gain_nm_per_v"])
    if result.get("accepted") is None or consistency is None:
        return Verdict("look", f"Gain {gain} N·m/V from one experiment: consistency unknown.")
    against = "" if limit is None else f" (limit {100 * limit:.1f} %)"
    words = f"gain {gain} N·m/V, consistency {100 * consistency:.2f} %{against}."
    if result["accepted"]:
        return Verdict("good", f"Calibration accepted: {words}")
    broken = [
        t["name"] for t in result.get("acceptance", {}).get("tests", []) if t["passed"] is False
    ]
    reason = f"; not held: {', '.join(broken)}" if broken else ""
    return Verdict("bad", f"Calibration not accepted: {words[:-1]}{reason}.")


def summary(result: Mapping[str, Any], source: Source) -> str:
    """Say in plain words what the calibration found."""
    gain = result["gain_nm_per_v"]
    lines = result.get("experiments", [])
    text = (
        f"With the wave generator locked, weights on the arm were read in {len(lines)} loading "
        f"experiments. One volt of the amplified bridge stands for {with_std(gain)} N·m. "
    )
    consistency, interval = value_of(result, "consistency"), result.get("consistency_interval")
    if consistency is not None:
        text += f"The gains of the experiments scatter by {100 * consistency:.2f} % of their mean"
        if isinstance(interval, list) and interval[1] is not None:
            text += f" (95 %: {100 * interval[0]:.2f} to {100 * interval[1]:.2f} %)"
        text += "; the bench of CIM-TR-97-06 had 6.60 N·m/V and 2 %. "
    of_mean = result.get("uncertainty", {}).get("mean_of_positions")
    if of_mean is not None:
        value, expanded = rounded_with(of_mean["value"], of_mean["expanded"])
        one = result.get("gain_basis") in ("residual", "repetitions")
        where = (
            "At this one flexspline position, without the spread between positions,"
            if one
            else "Averaged over flexspline positions"
        )
        text += (
            f"{where} the gain is {value} N·m/V with an expanded "
            f"uncertainty of {expanded} N·m/V (k = {of_mean['coverage_factor']:.2f}, 95 %). "
        )
    worst = max((float(line["residual_rms_nm"]) for line in lines), default=None)
    if worst is not None:
        text += f"Around their lines the readings scatter by at most {1e3 * worst:.1f} mN·m rms. "
    if source.profile is not None:
        stated = source.profile.data.sensor.gain_nm_per_v
        change = 100.0 * (float(gain["value"]) / stated - 1.0)
        text += f"That is {short(change, 0.1)} % off the {stated:g} N·m/V of the profile."
    return text


def numbers(result: Mapping[str, Any], run_id: str) -> tuple[KeyNumber, ...]:
    """Return gain, consistency and size of the calibration."""
    one = result.get("uncertainty", {}).get("any_one_position")
    interval = result.get("consistency_interval") or (None, None)
    within = "" if None in interval else f", 95 %: {interval[0]:.2g} to {interval[1]:.2g}"
    rows = (
        (result["gain_nm_per_v"], "torque gain", "gain_nm_per_v", "N m/V"),
        (one, "torque gain, any one position", "uncertainty.any_one_position", "N m/V"),
        (result.get("consistency"), f"consistency{within}", "consistency", ""),
        (result.get("n_experiments"), "experiments", "n_experiments", ""),
        (result.get("class"), "class (indicative)", "class", ""),
    )
    return key_numbers(rows, run_id)


def pictures(source: Source, prefix: str, _doubts: list[str]) -> tuple[Picture, ...]:
    """Draw the figures of the record."""
    loads = None if source.loads is None else _evaluated(source.loads, source.result)
    return record_pictures(source.result, loads, prefix)


def _evaluated(loads: Loads, result: Mapping[str, Any]) -> Loads:
    """Return the readings that were evaluated, with the applied torque that was used."""
    told = result.get("readings", ())
    if len(told) != len(loads):
        return loads
    readings = tuple(
        replace(reading, torque_nm=float(body["torque_nm"]))
        for reading, body in zip(loads.readings, told, strict=True)
        if body["kind"] == "reading"
    )
    return Loads(readings, loads.source)


def data_pictures(source: Source, prefix: str) -> tuple[Picture, ...]:
    """Draw readings that were not evaluated yet, with the line of each experiment."""
    from hdbench.calibration import evaluate_calibration

    if source.loads is None:
        return ()
    limit = 0.05 if source.profile is None else source.profile.data.calibration.max_consistency
    found = evaluate_calibration(source.loads, max_consistency=limit).to_json()
    return tuple(range_pictures(source.loads, found["experiments"], prefix))
