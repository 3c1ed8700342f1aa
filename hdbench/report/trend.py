"""The page of a trend: one quantity over runs, with control charts, steps and drift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib.dates
import numpy as np

from hdbench.records import FloatArray
from hdbench.report.canvas import COLOURS, draw_svg, label_axes, legend_above, new_figure
from hdbench.report.elements import KeyNumber, Picture, ReportFiles, Section, Table, Verdict
from hdbench.report.numbers import short, unit_words
from hdbench.report.page import PageWords, render_page
from hdbench.report.pagefiles import page_files, write_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["write_trend"]

_DATES: Any = matplotlib.dates  # has no types
_CHARTS = {
    "individuals": "a run beyond its limits",
    "moving-range": "a run far from the one before it",
    "ewma": "the moving average beyond its limits",
    "step": "the level has changed",
}
# marks with their words in the figure; the table has all
_MOST_MARKS = 8
_LONGEST_MARK = 24


def write_trend(body: Mapping[str, Any], table: str, out: Path) -> ReportFiles:
    """Write a trend as one offline page, with CSV and JSON beside it."""
    files = page_files(out, option="--html", example="trend.html")
    sections = [_section(group, body, k) for k, group in enumerate(body["groups"], start=1)]
    if not sections or body["remarks"] or body["left_out"]:
        sections.append(_about(body, empty=not sections))
    title = f"{body['label'][0].upper()}{body['label'][1:]} over runs"
    words = PageWords(title, "histories", _foot(body))
    return write_page(files, render_page(sections, files, words), table, body)


def _foot(body: Mapping[str, Any]) -> str:
    p = body["false_alarm_probability"]
    return (
        f"False alarms: a stable history shows any signal, on any of its four charts, with "
        f"probability {p:g} at one look, if its runs scatter independently and normally. The "
        f"limits are found by drawing stable histories of as many runs with the same "
        f"uncertainties; center and scatter are estimated from each as from the runs. Of "
        f"{len(body['groups'])} stable histories {p * len(body['groups']):.3g} are expected to "
        f"show one, and more where one looks again after every run. The moving average (EWMA) "
        f"weighs the newest run by {body['ewma_weight']:g}. The probability of a step is that of a "
        f"step anywhere in the history, with even odds before the data. A month has 30.44 days. "
        f"Uncertainties are standard uncertainties; intervals are at 95 %."
    )


def _title(group: Mapping[str, Any]) -> str:
    return ", ".join(filter(None, (group["name"], group["series"])))


def _section(group: Mapping[str, Any], body: Mapping[str, Any], number: int) -> Section:
    return Section(
        f"{group['by']} {_title(group)}",
        "trend",
        _title(group),
        _verdict(group),
        _doubts(group),
        _summary(group),
        _numbers(group),
        _pictures(group, body, number),
        _tables(group),
        (),
        (),
    )


def _verdict(group: Mapping[str, Any]) -> Verdict:
    n = len(group["points"])
    if group["limits"] is None:
        return Verdict("look", f"No limits: {group['why_no_limits']}.")
    if not group["signals"]:
        return Verdict("good", f"Stable: no signal in {n} runs.")
    charts = dict.fromkeys(signal["chart"] for signal in group["signals"])
    told = ", ".join(_CHARTS[chart] for chart in charts)
    return Verdict("look", f"Signal in {n} runs: {told}.")


def _doubts(group: Mapping[str, Any]) -> tuple[str, ...]:
    found = []
    undated = sum(not point["time_known"] for point in group["points"])
    if undated:
        found.append(
            f"{undated} runs have no date of measurement: that of their evaluation stands for it."
        )
    unsure = sum(point["std"] is None for point in group["points"])
    if unsure:
        found.append(f"{unsure} runs have no uncertainty of their own: it is taken as 0.")
    return tuple(found)


def _summary(group: Mapping[str, Any]) -> str:
    unit = unit_words(group["unit"])
    words = []
    for change in group["change_points"]:
        step, size = change["step"], change["step"]["value"]
        after = f", after: {'; '.join(change['marks'])}" if change["marks"] else ""
        words.append(
            f"At {change['run']} the level steps {'up' if size > 0 else 'down'} by "
            f"{short(abs(size), step['std'])} ± {short(step['std'], step['std'])} {unit} "
            f"(probability {_chance(change['probability'])}; first run after it between "
            f"{change['earliest_run']} and {change['latest_run']}){after}."
        )
    drift = group["drift_per_month"]
    if drift is not None and drift["interval"][0] * drift["interval"][1] > 0.0:
        words.append(
            f"It drifts by {short(drift['value'], drift['std'])} ± "
            f"{short(drift['std'], drift['std'])} {unit} a month."
        )
    return " ".join(words)


def _chance(probability: float) -> str:
    return f"{probability:.2g}" if probability < 0.995 else "above 0.99"


def _numbers(group: Mapping[str, Any]) -> tuple[KeyNumber, ...]:
    unit, title = group["unit"], _title(group)
    last = group["points"][-1]
    found = []
    limits, drift = group["limits"], group["drift_per_month"]
    if limits is not None:
        center = limits["center"]
        found.append(
            KeyNumber(f"mean, {title}", "center", center["value"], unit, title, center["std"])
        )
    if drift is not None:
        found.append(
            KeyNumber(
                f"drift a month, {title}",
                "drift_per_month",
                drift["value"],
                f"{unit}/month" if unit != "1" else "1/month",
                title,
                drift["std"],
                drift["dof"],
                "between the steps" if group["change_points"] else "",
            )
        )
    found.append(KeyNumber("last run", "last", last["value"], unit, title, last["std"] or None))
    if limits is not None:
        found += [
            KeyNumber("scatter of one run", "run_std", limits["run_std"], unit, title),
            KeyNumber("beyond own uncertainty", "between", limits["between_run_std"], unit, title),
        ]
    return tuple(found)


def _tables(group: Mapping[str, Any]) -> tuple[Table, ...]:
    found = []
    if group["signals"]:
        signals = tuple(
            (s["time_utc"][:10], s["run"], s["chart"], short(s["value"]), short(s["limit"]))
            for s in group["signals"]
        )
        note = (
            "Statistic and limit: stds of the run (individuals, EWMA), expected ranges (moving "
            "range), log-odds (step)."
        )
        head = ("date", "run", "chart", "statistic", "limit")
        found.append(Table("Signals", head, signals, note, wide=True, folded=len(signals) > 12))
    if group["marks"]:
        notes = tuple((m["time_utc"][:10], m["run"], m["text"]) for m in group["marks"])
        found.append(Table("Noted", ("date", "run", "note"), notes, wide=True))
    points = tuple(
        (
            point["time_utc"][:16].replace("T", " "),
            point["run"],
            short(point["value"], point["std"]),
            "" if point["std"] is None else short(point["std"], point["std"]),
        )
        for point in group["points"]
    )
    columns = ("measured, UTC", "run", f"value ({unit_words(group['unit'])})", "std")
    found.append(Table("Runs", columns, points, wide=True, folded=True))
    return tuple(found)


def _column(points: Sequence[Mapping[str, Any]], key: str) -> FloatArray:
    return np.array([np.nan if p.get(key) is None else p[key] for p in points], dtype=np.float64)


def _pictures(
    group: Mapping[str, Any], body: Mapping[str, Any], number: int
) -> tuple[Picture, ...]:
    points = group["points"]
    times = np.array([_days(point["time_utc"]) for point in points])
    unit = unit_words(group["unit"])
    charted = group["limits"] is not None
    ratios = (2.2, 1.0, 1.3) if charted else (1.0,)
    figure, axes = new_figure(len(ratios), 6.4 if charted else 3.0, share_x=True, ratios=ratios)
    _draw_values(axes[0], times, points, group)
    label_axes(axes[0], None if charted else "measured", f"{body['label']}\n({unit})")
    if charted:
        _draw_ranges(axes[1], times, points)
        label_axes(axes[1], None, f"moving\nrange ({unit})")
        _draw_ewma(axes[2], times, points, group)
        label_axes(axes[2], "measured", f"EWMA\n({unit})")
    place = _DATES.AutoDateLocator(minticks=3, maxticks=6)
    axes[-1].xaxis.set_major_locator(place)
    axes[-1].xaxis.set_major_formatter(_DATES.ConciseDateFormatter(place))
    caption = (
        "Each run with its own standard uncertainty. Dashed: limits. Rings: signals. Dotted: "
        "where the level steps. Thin lines: what people noted."
        if charted
        else "Each run with its own standard uncertainty."
    )
    alt = (
        f"{body['label']} of {_title(group)} over {len(points)} runs, "
        f"{len(group['signals'])} signals, {len(group['change_points'])} steps."
    )
    return (Picture("Run by run", caption, alt, draw_svg(figure, f"trend-{number}", alt)),)


def _days(utc: str) -> float:
    return float(_DATES.date2num(datetime.fromisoformat(utc)))


def _draw_values(
    axes: Axes,
    times: FloatArray,
    points: Sequence[Mapping[str, Any]],
    group: Mapping[str, Any],
) -> None:
    values, stds = _column(points, "value"), np.nan_to_num(_column(points, "std"))
    axes.errorbar(
        times, values, stds, fmt="o", markersize=3.5, linewidth=0.0, elinewidth=0.8,
        color=COLOURS["measured"], ecolor=COLOURS["muted"], label="run",
    )  # fmt: skip
    for mark in group["marks"][:_MOST_MARKS]:
        axes.axvline(_days(mark["time_utc"]), color=COLOURS["muted"], linewidth=0.8)
        text = mark["text"]
        words = text if len(text) <= _LONGEST_MARK else f"{text[: _LONGEST_MARK - 1]}…"
        axes.annotate(
            words, (_days(mark["time_utc"]), 0.02), xycoords=("data", "axes fraction"),
            xytext=(2, 0), textcoords="offset points", fontsize=8.0, color=COLOURS["ink"],
            rotation=90, va="bottom",
        )  # fmt: skip
    if group["limits"] is None:
        return
    _limits(axes, times, points, ("lower", "upper"))
    center = group["limits"]["center"]["value"]
    axes.axhline(center, color=COLOURS["muted"], linewidth=0.9, label="mean")
    for change in group["change_points"]:
        axes.axvline(_days(change["time_utc"]), color=COLOURS["expected"], linestyle=":")
    _rings(axes, times, values, points, ("individuals", "step"))
    legend_above(axes, columns=4)


def _draw_ranges(axes: Axes, times: FloatArray, points: Sequence[Mapping[str, Any]]) -> None:
    ranges = _column(points, "moving_range")
    axes.plot(times, ranges, "-o", markersize=2.5, linewidth=0.8, color=COLOURS["measured"])
    _limits(axes, times, points, ("moving_range_upper",))
    _rings(axes, times, ranges, points, ("moving-range",))
    axes.set_ylim(bottom=0.0)


def _draw_ewma(
    axes: Axes,
    times: FloatArray,
    points: Sequence[Mapping[str, Any]],
    group: Mapping[str, Any],
) -> None:
    ewma = _column(points, "ewma")
    axes.plot(times, ewma, "-o", markersize=2.5, linewidth=0.8, color=COLOURS["filtered"])
    axes.axhline(group["limits"]["center"]["value"], color=COLOURS["muted"], linewidth=0.9)
    _limits(axes, times, points, ("ewma_lower", "ewma_upper"))
    _rings(axes, times, ewma, points, ("ewma",))


def _limits(
    axes: Axes, times: FloatArray, points: Sequence[Mapping[str, Any]], keys: Sequence[str]
) -> None:
    for k, key in enumerate(keys):
        axes.plot(
            times, _column(points, key), "--", linewidth=0.9, color=COLOURS["expected"],
            label="limits" if k == 0 else None,
        )  # fmt: skip


def _rings(
    axes: Axes,
    times: FloatArray,
    values: FloatArray,
    points: Sequence[Mapping[str, Any]],
    charts: Sequence[str],
) -> None:
    here = np.array([any(chart in charts for chart in point["signals"]) for point in points])
    if np.any(here):
        axes.plot(
            times[here], values[here], "o", markersize=8, markerfacecolor="none",
            markeredgecolor=COLOURS["before"], markeredgewidth=1.4, label="signal",
        )  # fmt: skip


def _about(body: Mapping[str, Any], *, empty: bool) -> Section:
    """Return the section on what is due, and on the runs that took no part."""
    remarks, left = body["remarks"], body["left_out"]
    text = "What is due, and which runs took no part."
    if empty:
        text = f"No run with {body['label']}."
    elif not remarks:
        text = f"{len(left)} runs took no part."
    rows = tuple((row["run"], row["why"]) for row in left)
    return Section(
        "all runs",
        "trend",
        "Beside the charts",
        Verdict("look" if remarks or empty else "good", text),
        (),
        " ".join(remarks),
        (),
        (),
        (Table("Left out", ("run", "why"), rows, wide=True, folded=len(rows) > 12),)
        if rows
        else (),
        (),
        (),
    )
