"""Calibration in a report: verdict, summary, key numbers, figures, tables and the record."""

from __future__ import annotations

from dataclasses import replace

from hdbench.records import Loads
from hdbench.report.calibration.figures import range_pictures, record_pictures
from hdbench.report.calibration.tables import record_tables as tables
from hdbench.report.numbers import rounded_with, short, with_std
from hdbench.report.pagemodel import KeyNumber, Picture, Verdict
from hdbench.report.source import Source
from hdbench.results import CalibrationResult

__all__ = ["data_pictures", "numbers", "pictures", "summary", "tables", "verdict"]


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


def summary(result: CalibrationResult, source: Source) -> str:
    """Say in plain words what the calibration found."""
    gain = result.gain_nm_per_v
    lines = result.experiments
    text = (
        f"With the wave generator locked, weights on the arm were read in {len(lines)} loading "
        f"experiments. One volt of the amplified bridge stands for {with_std(gain)} N·m. "
    )
    consistency, interval = result.consistency, result.consistency_interval
    if consistency is not None:
        text += f"The gains of the experiments scatter by {100 * consistency:.2f} % of their mean"
        if interval is not None:
            text += f" (95 %: {100 * interval[0]:.2f} to {100 * interval[1]:.2f} %)"
        text += "; the bench of CIM-TR-97-06 had 6.60 N·m/V and 2 %. "
    of_mean = result.uncertainty.mean_of_positions if result.uncertainty else None
    if of_mean is not None:
        value, expanded = rounded_with(of_mean.value, of_mean.expanded)
        one = result.gain_basis in ("residual", "repetitions")
        where = (
            "At this one flexspline position, without the spread between positions,"
            if one
            else "Averaged over flexspline positions"
        )
        text += (
            f"{where} the gain is {value} N·m/V with an expanded "
            f"uncertainty of {expanded} N·m/V (k = {of_mean.coverage_factor:.2f}, 95 %). "
        )
    worst = max((line.residual_rms_nm for line in lines), default=None)
    if worst is not None:
        text += f"Around their lines the readings scatter by at most {1e3 * worst:.1f} mN·m rms. "
    if source.profile is not None:
        stated = source.profile.data.sensor.gain_nm_per_v
        change = 100.0 * (gain.value / stated - 1.0)
        text += f"That is {short(change, 0.1)} % off the {stated:g} N·m/V of the profile."
    return text


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
