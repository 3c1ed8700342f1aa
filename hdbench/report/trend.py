"""Page of a trend: one quantity over runs, with control charts, steps and drift."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import matplotlib.dates
import numpy as np

from hdbench.records import FloatArray
from hdbench.report.canvas import COLOURS, Panel, new_figure
from hdbench.report.numbers import unit_words
from hdbench.report.page import ReportFiles, page_files, write_page
from hdbench.report.pagemodel import KeyNumber, Picture, Section, Table, Verdict
from hdbench.report.texts import page_text, summary

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
# a longer table is folded
_LONG = 12
Group = Mapping[str, Any]


def write_trend(body: Mapping[str, Any], table: str, out: Path) -> ReportFiles:
    """Write a trend as one offline page, with CSV and JSON beside it."""
    files = page_files(out, option="--html", example="trend.html")
    sections = [_section(group, body, k) for k, group in enumerate(body["groups"], start=1)]
    if not sections or body["remarks"] or body["left_out"]:
        sections.append(_left_out(body, empty=not sections))
    title = f"{body['label'][0].upper()}{body['label'][1:]} over runs"
    chance, count = body["false_alarm_probability"], len(body["groups"])
    numbers = {"chance": chance, "count": count, "expected": chance * count}
    foot = page_text("trend_foot", weight=body["ewma_weight"], **numbers)
    return write_page(files, sections, table, body, title=title, noun="histories", foot=foot)


def _title(group: Group) -> str:
    return ", ".join(filter(None, (group["name"], group["series"])))


def _section(group: Group, body: Mapping[str, Any], number: int) -> Section:
    return Section(
        f"{group['by']} {_title(group)}",
        "trend",
        _title(group),
        _verdict(group),
        tuple(_doubts(group)),
        summary("trend", group),
        tuple(_numbers(group)),
        (_picture(group, body, number),),
        _tables(group),
    )


def _verdict(group: Group) -> Verdict:
    n = len(group["points"])
    if group["limits"] is None:
        return Verdict("look", f"No limits: {group['why_no_limits']}.")
    if not group["signals"]:
        return Verdict("good", f"Stable: no signal in {n} runs.")
    charts = dict.fromkeys(signal["chart"] for signal in group["signals"])
    told = ", ".join(_CHARTS[chart] for chart in charts)
    return Verdict("look", f"Signal in {n} runs: {told}.")


def _doubts(group: Group) -> Iterator[str]:
    undated = sum(not point["time_known"] for point in group["points"])
    if undated:
        yield f"{undated} runs have no date of measurement: that of their evaluation stands for it."
    unsure = sum(point["std"] is None for point in group["points"])
    if unsure:
        yield f"{unsure} runs have no uncertainty of their own: it is taken as 0."


def _numbers(group: Group) -> Iterator[KeyNumber]:
    unit, title = group["unit"], _title(group)
    last = group["points"][-1]
    limits, drift = group["limits"], group["drift_per_month"]
    if limits is not None:
        center = limits["center"]
        yield KeyNumber(f"mean, {title}", "center", center["value"], unit, title, center["std"])
    if drift is not None:
        yield KeyNumber(
            f"drift a month, {title}",
            "drift_per_month",
            drift["value"],
            f"{unit}/month",
            title,
            drift["std"],
            drift["dof"],
            "between the steps" if group["change_points"] else "",
        )
    yield KeyNumber("last run", "last", last["value"], unit, title, last["std"] or None)
    if limits is not None:
        yield KeyNumber("scatter of one run", "run_std", limits["run_std"], unit, title)
        between = limits["between_run_std"]
        yield KeyNumber("beyond own uncertainty", "between", between, unit, title)


def _tables(group: Group) -> tuple[Table, ...]:
    many = len(group["signals"]) > _LONG
    return Table.filled(
        Table.told("signals", group["signals"], folded=many),
        Table.told("marks", group["marks"]),
        Table.told("points", group["points"], unit=unit_words(group["unit"])),
    )


def _picture(group: Group, body: Mapping[str, Any], number: int) -> Picture:
    unit, charted = unit_words(group["unit"]), group["limits"] is not None
    ratios = (2.2, 1.0, 1.3) if charted else (1.0,)
    figure, axes = new_figure(len(ratios), 6.4 if charted else 3.0, share_x=True, ratios=ratios)
    charts = _Charts(group)
    charts.draw_values(axes[0])
    axes[0].label(None, f"{body['label']}\n({unit})")
    if charted:
        charts.draw_line(axes[1], "moving_range", "measured", ("moving_range_upper",))
        axes[1].set_ylim(bottom=0.0)
        axes[1].label(None, f"moving\nrange ({unit})")
        charts.draw_line(axes[2], "ewma", "filtered", ("ewma_lower", "ewma_upper"))
        axes[2].axhline(group["limits"]["center"]["value"], color=COLOURS["muted"], linewidth=0.9)
        axes[2].label(None, f"EWMA\n({unit})")
    axes[-1].set_xlabel("measured")
    place = _DATES.AutoDateLocator(minticks=3, maxticks=6)
    axes[-1].xaxis.set_major_locator(place)
    axes[-1].xaxis.set_major_formatter(_DATES.ConciseDateFormatter(place))
    marks = (
        " Dashed: limits. Rings: signals. Dotted: where the level steps. Thin lines: what people "
        "noted."
    )
    counts = {"signals": len(group["signals"]), "steps": len(group["change_points"])}
    return Picture.drawn(
        figure,
        f"trend-{number}",
        "trend",
        label=body["label"],
        title=_title(group),
        runs=len(group["points"]),
        marks=marks if charted else "",
        **counts,
    )


def _days(utc: str) -> float:
    return float(_DATES.date2num(datetime.fromisoformat(utc)))


class _Charts:
    """Charts of one history."""

    def __init__(self, group: Group) -> None:
        self._group, self._points = group, group["points"]
        self._times = np.array([_days(point["time_utc"]) for point in self._points])

    def _column(self, key: str) -> FloatArray:
        cells = (point.get(key) for point in self._points)
        return np.array([np.nan if cell is None else cell for cell in cells], dtype=np.float64)

    def draw_values(self, axes: Panel) -> None:
        """Draw the runs with their uncertainties, marks, limits, steps and signals."""
        group, values = self._group, self._column("value")
        axes.errorbar(
            self._times, values, np.nan_to_num(self._column("std")), fmt="o", markersize=3.5,
            linewidth=0.0, elinewidth=0.8, color=COLOURS["measured"], ecolor=COLOURS["muted"],
            label="run",
        )  # fmt: skip
        for mark in group["marks"][:_MOST_MARKS]:
            day, text = _days(mark["time_utc"]), mark["text"]
            axes.axvline(day, color=COLOURS["muted"], linewidth=0.8)
            words = text if len(text) <= _LONGEST_MARK else f"{text[: _LONGEST_MARK - 1]}…"
            axes.annotate(
                words, (day, 0.02), xycoords=("data", "axes fraction"), xytext=(2, 0),
                textcoords="offset points", fontsize=8.0, color=COLOURS["ink"], rotation=90,
                va="bottom",
            )  # fmt: skip
        if group["limits"] is not None:
            self._draw_limits(axes, ("lower", "upper"))
            center = group["limits"]["center"]["value"]
            axes.axhline(center, color=COLOURS["muted"], linewidth=0.9, label="mean")
            for change in group["change_points"]:
                day = _days(change["time_utc"])
                axes.axvline(day, color=COLOURS["expected"], linestyle=":")
            self._draw_rings(axes, values, {"individuals", "step"})
            axes.legend_above(columns=4)

    def draw_line(self, axes: Panel, key: str, colour: str, limits: Sequence[str]) -> None:
        """Draw one statistic with its limits and signals."""
        values = self._column(key)
        axes.curve(self._times, values, colour, "-o", markersize=2.5, linewidth=0.8)
        self._draw_limits(axes, limits)
        self._draw_rings(axes, values, {key.replace("_", "-")})

    def _draw_limits(self, axes: Panel, keys: Sequence[str]) -> None:
        for key, label in zip(keys, ("limits", None), strict=False):
            style = {"linewidth": 0.9, "label": label}
            axes.curve(self._times, self._column(key), "expected", "--", **style)

    def _draw_rings(self, axes: Panel, values: FloatArray, charts: set[str]) -> None:
        here = np.array([not charts.isdisjoint(point["signals"]) for point in self._points])
        if np.any(here):
            axes.plot(
                self._times[here], values[here], "o", markersize=8, markerfacecolor="none",
                markeredgecolor=COLOURS["before"], markeredgewidth=1.4, label="signal",
            )  # fmt: skip


def _left_out(body: Mapping[str, Any], *, empty: bool) -> Section:
    """Return the section on what is due, and on the runs that took no part."""
    remarks, left = body["remarks"], body["left_out"]
    text = "What is due, and which runs took no part."
    if empty:
        text = f"No run with {body['label']}."
    elif not remarks:
        text = f"{len(left)} runs took no part."
    return Section(
        "all runs",
        "trend",
        "Beside the charts",
        Verdict("look" if remarks or empty else "good", text),
        summary=" ".join(remarks),
        tables=Table.filled(Table.told("left_out", left, folded=len(left) > _LONG)),
    )
