"""Sentences on what a group of runs needs: a calibration that is due, a filter that has aged."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

from hdbench.errors import DataError
from hdbench.profile.scaling import calibration_time
from hdbench.records import RunSummary, read_json

__all__ = ["remarks"]

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
    days = read_json(run.path / "result.json").get("validity_days")
    if text is None or days is None:
        return []
    moment = datetime.fromisoformat(text)
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    due = moment + timedelta(days=float(days))
    if now < due:
        return []
    age = (now - moment) / timedelta(days=1)
    at_least = "" if measured else "at least "
    return [
        f"The calibration of {name} became due on {due:%Y-%m-%d}: {run.path.name} is "
        f"{at_least}{age:.0f} days old and valid for {days:g}."
    ]


def _moved(run: RunSummary, name: str) -> list[str]:
    result = read_json(run.path / "result.json")
    model = read_json(run.path / "run.json").get("filter") or {}
    blocks = [float(block["order"]) for block in model.get("blocks", ())]
    ripple = [row for row in result["ripple"] if row.get("order_estimate")]
    words = []
    for row in ripple:
        order, estimate = float(row["order"]), row["order_estimate"]
        if min((abs(order - block) for block in blocks), default=_SLIP) >= _SLIP:
            words.append(f"order {order:g} ({_amplitude(row)}) is in no block of it")
            continue
        off = float(estimate["value"]) - order
        if abs(off) > max(_SLIP, _STDS * float(estimate["std"])):
            words.append(f"order {order:g} is now at {float(estimate['value']):.5g}")
    for line in result.get("lines", ()):
        order = float(line["order"])
        if min((abs(order - block) for block in blocks), default=_SLIP) >= _SLIP:
            words.append(f"order {order:.4g} ({_amplitude(line)}) is in no block of it")
    if not words:
        return []
    return [
        f"The filter {model.get('name', '')} no longer fits {name}: in {run.path.name} "
        f"{', '.join(words)}."
    ]


def _amplitude(row: Mapping[str, Any]) -> str:
    return f"{float(row['amplitude_nm']['value']):.2g} N m"
