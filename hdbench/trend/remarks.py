"""Sentences on what a group of runs needs: a calibration that is due, a filter that has aged."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from typing import TypeVar

from hdbench.errors import DataError
from hdbench.profile.scaling import calibration_time
from hdbench.records import RunSummary, read_json
from hdbench.records.runfolder import moment_of
from hdbench.results import CalibrationResult, Part, RippleResult

_T = TypeVar("_T", bound=Part)

# an order has moved when it is off by so many stds and by so many cycles per turn: a block of the
# filter follows a phase that slips by less than one cycle in a thousand turns
_STDS, _SLIP = 4.0, 1e-3


def remarks(
    runs: Sequence[RunSummary], group: Callable[[RunSummary], str], now: datetime
) -> list[str]:
    """Return one sentence for every calibration that is due and every filter that has aged."""
    newest: dict[tuple[str, str], RunSummary] = {}
    for run in runs:
        if run.status == "complete" and run.verdict:
            newest[run.kind, group(run)] = run
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
