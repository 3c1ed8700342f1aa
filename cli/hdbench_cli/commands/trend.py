"""`hdbench trend`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hdbench.errors import LimitError, UsageError
from hdbench.records import write_atomic
from hdbench.records.runfolder import utc_now
from hdbench.trend import trend_csv, trend_of_runs
from hdbench_cli.commands.runs import chosen_runs
from hdbench_cli.inputs import refuse_same_csv
from hdbench_cli.output import Output
from hdbench_cli.text import Line, Lines, styled, table, with_uncertainty


def trend_command(
    output: Output,
    /,
    quantity: str,
    parent: Path,
    by: str,
    orders: tuple[float, ...],
    probability: float,
    seed: int,
    check: bool,
    csv_file: Path | None,
    html_file: Path | None,
    **options: Any,
) -> None:
    """Follow one quantity over the runs of a folder: control charts, steps, drift."""
    refuse_same_csv(csv_file, html_file)
    if orders and quantity != "ripple":
        raise UsageError(
            f"--order with {quantity}", where="--order", fix="leave it out, or ask for ripple"
        )
    runs = chosen_runs(parent, options)
    body = trend_of_runs(
        runs,
        quantity,
        now=utc_now(),
        by=by,
        orders=orders,
        probability=probability,
        seed=seed,
    )
    files: dict[str, str] = {}
    if csv_file is not None:
        write_atomic(csv_file, trend_csv(body).encode())
        files["csv"] = str(csv_file)
    if html_file is not None:
        from hdbench.report.trend import write_trend

        files["html"] = str(write_trend(body, trend_csv(body), html_file).html)
    body["files"] = files
    output.result(body, _lines(body, parent))
    names = [_title(group) for group in body["groups"] if group["signals"]]
    if check and names:
        more = " ..." if len(names) > 5 else ""
        output.end(
            LimitError(
                f"{body['label']}: signals in {len(names)} of {len(body['groups'])} histories: "
                f"{', '.join(names[:5])}{more}",
                where=str(parent),
                fix="look at the charts (--html), measure again, and note what was done "
                "(runs note)",
            )
        )


def _title(group: Mapping[str, Any]) -> str:
    return ", ".join(filter(None, (group["name"], group["series"])))


def _number(body: Mapping[str, Any] | None) -> str:
    return "" if body is None else with_uncertainty({**body, "dof": None}, "").strip()


def _lines(body: Mapping[str, Any], parent: Path) -> Lines:
    """Yield one row a history, then what stands out."""
    if body["groups"]:
        heads = (body["by"], "runs", "mean", "scatter", "drift a month", "signals")
        title = f"{body['label']} ({body['groups'][0]['unit']})"
        yield table(heads, map(_row, body["groups"]), title=title)
    else:
        yield f"no run with {body['label']} in {parent.resolve()}"
    lines = [text for group in body["groups"] for text in _remarkable(group)]
    lines += [("look", text) for text in body["remarks"]]
    lines += [("left out", f"{row['run']}: {row['why']}") for row in body["left_out"]]
    lines += [("page" if name == "html" else name, path) for name, path in body["files"].items()]
    yield from (f"{name:9}{text}" for name, text in lines)
    if any(group["limits"] for group in body["groups"]):
        share = f"{body['false_alarm_probability']:g}, all its charts together"
        yield styled((f"one stable history shows any signal with probability {share}", "dim"))


def _row(group: Mapping[str, Any]) -> list[Line]:
    limits, count = group["limits"], len(group["signals"])
    head: list[Line] = [_title(group), str(len(group["points"]))]
    if limits is None:
        return [*head, f"{group['points'][-1]['value']:.5g} (last)", "", "", group["why_no_limits"]]
    return [
        *head,
        _number(limits["center"]),
        f"{limits['run_std']:.2g}",
        _number(group["drift_per_month"]),
        styled((str(count), "bold red" if count else "green")),
    ]


def _remarkable(group: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return what stands out in one history."""
    title, unit = _title(group), group["unit"]
    found = []
    for change in group["change_points"]:
        chance = f"{change['probability']:.2g}" if change["probability"] < 0.995 else "above 0.99"
        after = f", after {'; '.join(change['marks'])}" if change["marks"] else ""
        found.append(
            (
                "step",
                f"{title}: by {_number(change['step'])} {unit} at {change['run']}, "
                f"probability {chance}{after}",
            )
        )
    for chart in dict.fromkeys(signal["chart"] for signal in group["signals"]):
        runs = [signal["run"] for signal in group["signals"] if signal["chart"] == chart]
        more = "" if len(runs) == 1 else f" and {len(runs) - 1} more, the last {runs[-1]}"
        found.append(("signal", f"{title}: {chart} at {runs[0]}{more}"))
    return found
