"""One quantity over runs, group by group: points, charts, changes, drift, and what is due."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from hdbench.errors import DataError
from hdbench.profile.scaling import calibration_time, measured_utc
from hdbench.records import Quantity, RunSummary, read_json, read_notes, result_header
from hdbench.records.csvtext import csv_text, safe_cell
from hdbench.records.runfolder import moment_of
from hdbench.results import RESULT_TYPES, CalibrationResult, DiagnosisResult, Part, RippleResult
from hdbench.trend.charts import EWMA_WEIGHT, Change, Chart, History, Limits, Signal, study_history
from hdbench.trend.quantities import QUANTITIES, Reading

_COLUMNS = (
    *("name", "series", "unit", "run", "time_utc", "value", "std", "lower", "upper"),
    *("moving_range", "moving_range_upper", "ewma", "ewma_lower", "ewma_upper", "signals"),
)
_MONTH = timedelta(days=365.25 / 12)
_DATA = ("trace.csv", "trace.csv.gz", "loads.csv", "loads.csv.gz")
# an order has moved when it is off by so many stds and by so many cycles per turn: a block of the
# filter follows a phase that slips by less than one cycle in a thousand turns
_STDS, _SLIP = 4.0, 1e-3
_T = TypeVar("_T", bound=Part)


@dataclass(frozen=True, slots=True)
class _Run:
    """A run that took part: its summary, when it was measured, and its result."""

    summary: RunSummary
    moment: datetime
    dated: bool
    result: Any


def trend_of_runs(
    runs: Sequence[RunSummary],
    quantity: str,
    *,
    now: datetime,
    by: str = "drive",
    orders: Sequence[float] = (),
    probability: float = 0.05,
    seed: int = 0,
) -> dict[str, Any]:
    """Follow one quantity over runs.

    Parameters
    ----------
    runs : sequence of RunSummary
        Runs to look at; those of other kinds give marks and tell whether a calibration is due.
    quantity : str
        A key of `QUANTITIES`.
    now : datetime
        The present, with a time zone.
    by : {"drive", "sensor", "profile"}
        What makes a group. Runs that do not name it are grouped by their profile.
    orders : sequence of float
        Of the ripple: these only.
    probability : float
        Of any signal in one stable history, all its charts together.
    seed : int
        Of the histories that are drawn to find the limits.

    Returns
    -------
    dict
        Contract section 5, schema ``hdbench/trend/1``.
    """
    chosen = QUANTITIES[quantity]
    left_out: list[dict[str, str]] = []
    taken = list(_usable(runs, set(chosen.readers), left_out))
    series: dict[tuple[str, str], list[tuple[_Run, Reading]]] = defaultdict(list)
    wanted = {f"order {order:g}" for order in orders}
    for run in taken:
        readings = _readings(run, chosen.readers[run.summary.kind])
        if not readings:
            left_out.append(_left_out(run.summary, f"no {quantity} in its result"))
        for reading in readings:
            if not wanted or reading.series in wanted:
                series[_group(run.summary, by), reading.series].append((run, reading))
    groups = []
    for (name, what), points in sorted(series.items()):
        points.sort(key=lambda point: point[0].moment)
        history = study_history(
            np.array([reading.value for _, reading in points]),
            np.array([reading.std or 0.0 for _, reading in points]),
            np.array([(run.moment - points[0][0].moment) / _MONTH for run, _ in points]),
            probability=probability,
            draw=np.random.default_rng(seed),
        )
        # a parameter of a cause ends in its own unit
        unit = "N m s/rad" if what.endswith("_nm_s_per_rad") else chosen.unit
        head = {"by": by, "name": name, "series": what, "unit": unit}
        marks = _marks([run for run in runs if _group(run, by) == name])
        groups.append({**head, **_body(points, history, marks)})
    return {
        **result_header("trend", None),
        "quantity": quantity,
        "label": chosen.label,
        "by": by,
        "false_alarm_probability": probability,
        "ewma_weight": EWMA_WEIGHT,
        "groups": groups,
        "remarks": _remarks(runs, by, now),
        "left_out": left_out,
    }


def trend_csv(body: Mapping[str, Any]) -> str:
    """Return the points of a trend as CSV, one row a run.

    Parameters
    ----------
    body : mapping
        What `trend_of_runs` gave.

    Returns
    -------
    str
        Names that a spreadsheet would take for a formula start with an apostrophe.
    """
    rows = (
        {**group, **point, "signals": " ".join(point.get("signals", ()))}
        for group in body["groups"]
        for point in group["points"]
    )
    return csv_text(_COLUMNS, ([safe_cell(row.get(name)) for name in _COLUMNS] for row in rows))


def _group(run: RunSummary, by: str) -> str:
    return str(getattr(run, by)) or f"profile {run.profile}"


def _left_out(run: RunSummary, why: str) -> dict[str, str]:
    return {"run": run.path.name, "why": why}


def _usable(
    runs: Sequence[RunSummary], kinds: set[str], left_out: list[dict[str, str]]
) -> Iterator[_Run]:
    """Yield the runs of these kinds that count; of one record the newest evaluation."""
    newest: dict[tuple[str, str], _Run] = {}
    for run in runs:
        if run.kind not in kinds:
            continue
        if run.status != "complete":
            left_out.append(_left_out(run, f"status {run.status}"))
            continue
        try:
            body = read_json(run.path / "result.json", f"hdbench/{run.kind}/1")
            manifest = read_json(run.path / "run.json")
            result = RESULT_TYPES[run.kind].from_json(body, str(run.path / "result.json"))
            moment, dated = _measured(run, manifest)
        except DataError as error:
            left_out.append(_left_out(run, error.what))
            continue
        if any(body.get(key) for key in ("doubts", "flags", "data_flags")):
            left_out.append(_left_out(run, "its data are doubtful"))
            continue
        hashes = [manifest["files"].get(name) for name in _DATA]
        if isinstance(result, DiagnosisResult):
            hashes.append(result.input_sha256)
        key = (run.kind, str(next(filter(None, hashes), run.path.name)))
        if key in newest:
            older = newest[key].summary
            left_out.append(_left_out(older, f"the same data as {run.path.name}"))
        newest[key] = _Run(run, moment, dated, result)
    yield from newest.values()


def _measured(run: RunSummary, manifest: Mapping[str, Any]) -> tuple[datetime, bool]:
    """Return when a run was measured, and whether that is known; else when it was evaluated."""
    path = run.path
    details = manifest.get("details")
    if run.kind == "diagnosis" and isinstance(details, dict):
        # a diagnosis is as old as the run that it looked at
        named = Path(str(details.get("input", "")))
        path = next(
            (p for p in (named, path.parent / named.name) if (p / "run.json").is_file()), path
        )
    text = measured_utc(path)
    for known, candidate in ((True, text), (False, run.started_utc)):
        moment = moment_of(candidate)
        if moment is not None:
            return moment, known
    raise DataError("no time of measurement in run.json", where=str(path), fix="restore it")


def _readings(run: _Run, reader: Any) -> list[Reading]:
    try:
        return [r for r in reader(run.result) if np.isfinite(r.value)]
    except (KeyError, TypeError, ValueError, AttributeError):
        return []


def _utc(moment: datetime) -> str:
    return moment.astimezone(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def _marks(runs: Sequence[RunSummary]) -> list[dict[str, str]]:
    """Return what people noted on the runs of a group, by the start of the run."""
    dated = [(moment, run) for run in runs if (moment := moment_of(run.started_utc)) is not None]
    return [
        {"run": run.path.name, "time_utc": _utc(moment), "text": note.text}
        for moment, run in sorted(dated, key=lambda pair: pair[0])
        for note in read_notes(run.path)
    ]


def _body(
    points: Sequence[tuple[_Run, Reading]], history: History, marks: list[dict[str, str]]
) -> dict[str, Any]:
    rows: list[dict[str, Any]] = [
        {
            "run": run.summary.path.name,
            "path": str(run.summary.path),
            "time_utc": _utc(run.moment),
            "time_known": run.dated,
            "value": reading.value,
            "std": reading.std,
        }
        for run, reading in points
    ]
    signals = [
        {
            "chart": signal.chart,
            **{key: rows[signal.index][key] for key in ("run", "time_utc")},
            "value": signal.value,
            "limit": signal.limit,
        }
        for signal in history.signals
    ]
    chart, limits, told = history.chart, history.limits, None
    if chart is not None and limits is not None:
        rows = _with_limits(rows, chart, limits, history.signals)
        told = {
            "center": {
                "value": float(chart.center),
                "std": float(np.sqrt(1.0 / np.sum(1.0 / chart.stds**2))),
                "dof": None,
            },
            "between_run_std": float(chart.between_std),
            "run_std": float(np.median(chart.stds)),
            "factors": asdict(limits),
        }
    drift = history.drift_per_month
    return {
        "points": rows,
        "limits": told,
        "why_no_limits": history.why_not or None,
        "signals": signals,
        "drift_per_month": None if drift is None else _interval(drift),
        "change_points": [_change(change, rows, marks) for change in history.changes],
        "marks": marks,
    }


def _interval(quantity: Quantity) -> dict[str, Any]:
    return {**quantity.to_dict(), "interval": list(quantity.interval())}


def _with_limits(
    rows: list[dict[str, Any]], chart: Chart, limits: Limits, signals: Sequence[Signal]
) -> list[dict[str, Any]]:
    """Return the points with what the charts say of each, as plain numbers."""
    reach, slow = limits.individuals * chart.stds, limits.ewma * chart.ewma_stds
    columns = {
        "lower": (chart.center - reach).tolist(),
        "upper": (chart.center + reach).tolist(),
        # a range belongs to the later run
        "moving_range": [None, *chart.moving_range.tolist()],
        "moving_range_upper": [None, *(limits.moving_range * chart.expected_range).tolist()],
        "ewma": chart.ewma.tolist(),
        "ewma_lower": (chart.center - slow).tolist(),
        "ewma_upper": (chart.center + slow).tolist(),
        "signals": [[s.chart for s in signals if s.index == k] for k in range(len(rows))],
    }
    return [
        {**row, **{name: column[k] for name, column in columns.items()}}
        for k, row in enumerate(rows)
    ]


def _change(
    change: Change, rows: Sequence[Mapping[str, Any]], marks: Sequence[Mapping[str, str]]
) -> dict[str, Any]:
    step = change.step
    before, here = rows[step.earliest - 1]["time_utc"], rows[step.latest]["time_utc"]
    return {
        **{key: rows[step.index][key] for key in ("run", "time_utc")},
        "probability": step.probability,
        "earliest_run": rows[step.earliest]["run"],
        "latest_run": rows[step.latest]["run"],
        "step": _interval(change.size),
        "marks": [m["text"] for m in marks if before < m["time_utc"] <= here],
    }


def _remarks(runs: Sequence[RunSummary], by: str, now: datetime) -> list[str]:
    """Return one sentence for every calibration that is due and every filter that has aged."""
    newest: dict[tuple[str, str], RunSummary] = {}
    for run in runs:
        if run.status == "complete" and run.verdict:
            newest[run.kind, _group(run, by)] = run
    found: dict[str, list[str]] = defaultdict(list)
    for (kind, name), run in newest.items():
        try:
            if kind == "calibration":
                found[name] += _due(run, name, now)
            elif kind == "ripple":
                found[name] += _moved(run, name)
        except (DataError, KeyError, TypeError, ValueError):
            continue  # a damaged run is told among those left out
    return [sentence for name in sorted(found) for sentence in found[name]]


def _due(run: RunSummary, name: str, now: datetime) -> list[str]:
    text, measured = calibration_time(run.path)
    days = _result(run, CalibrationResult).validity_days
    moment = moment_of(text)
    if moment is None or days is None:
        return []
    due = moment + timedelta(days=days)
    if now < due:
        return []
    age = (now - moment) / timedelta(days=1)
    at_least = "" if measured else "at least "
    return [
        f"The calibration of {name} became due on {due:%Y-%m-%d}: {run.path.name} is "
        f"{at_least}{age:.0f} days old and valid for {days:g}."
    ]


def _moved(run: RunSummary, name: str) -> list[str]:
    result = _result(run, RippleResult)
    model = read_json(run.path / "run.json").get("filter") or {}
    blocks = [float(block["order"]) for block in model.get("blocks", ())]
    words = []
    for row in result.ripple:
        estimate = row.order_estimate
        if estimate is None:
            continue
        if not _held(row.order, blocks):
            words.append(
                f"order {row.order:g} ({row.amplitude_nm.value:.2g} N m) is in no block of it"
            )
        elif abs(estimate.value - row.order) > max(_SLIP, _STDS * estimate.std):
            words.append(f"order {row.order:g} is now at {estimate.value:.5g}")
    words += [
        f"order {line.order:.4g} ({line.amplitude_nm.value:.2g} N m) is in no block of it"
        for line in result.lines
        if not _held(line.order, blocks)
    ]
    if not words:
        return []
    return [
        f"The filter {model.get('name', '')} no longer fits {name}: in {run.path.name} "
        f"{', '.join(words)}."
    ]


def _held(order: float, blocks: Sequence[float]) -> bool:
    return any(abs(order - block) < _SLIP for block in blocks)


def _result(run: RunSummary, kind: type[_T]) -> _T:
    file = run.path / "result.json"
    return kind.from_json(read_json(file), str(file))
