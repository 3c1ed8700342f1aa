"""Figures of the calibration record."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hdbench.records import FloatArray, LoadReading, Loads
from hdbench.records.loads import SequenceEntry
from hdbench.report.calibration.tables import steps_of
from hdbench.report.canvas import COLOURS, new_figure
from hdbench.report.pagemodel import Picture
from hdbench.results import CalibrationResult
from hdbench.results.calibration import ExperimentLine, GroupSeries, LoadGroup, ReadingRecord

# one colour and one mark for each position: told apart without seeing colours as well
_COLOURS = ("filtered", "expected", "lowpass", "before", "measured", "ink")
_MARKS = ("o", "s", "^", "D", "v", "P", "X", "<")
_SIZE = 4.2
_RANGES = {"low": ("low-range", "6"), "full": ("full-range", "7")}
# a reading belongs to the top step when its torque is this share of its experiment's largest
_TOP = 0.98


def record_pictures(
    result: CalibrationResult, loads: Loads | None, prefix: str
) -> tuple[Picture, ...]:
    """Draw deviations, readings and lines, hysteresis, gains, budget, course, drift."""
    drawn: list[Picture | None] = [_deviations(result, name, prefix) for name in ("full", "low")]
    if loads is not None:
        drawn += range_pictures(loads, result.experiments, prefix)
    drawn += [
        draw(result, prefix) for draw in (_hysteresis, _gains, _budget, _sequence, _top_drift)
    ]
    return tuple(picture for picture in drawn if picture is not None)


def _style(position: int) -> dict[str, Any]:
    """Return colour and mark of a position's readings."""
    colour = COLOURS[_COLOURS[position % len(_COLOURS)]]
    return {"color": colour, "marker": _MARKS[position % len(_MARKS)], "markersize": _SIZE}


def _degrees(position_rad: float) -> str:
    return f"{math.degrees(position_rad):.4g}°"


def _sign(group: LoadGroup) -> float:
    return 1.0 if group.direction == "cw" else -1.0


def _labelled_series(
    groups: Sequence[LoadGroup],
) -> Iterator[tuple[LoadGroup, GroupSeries, str | None]]:
    """Yield every series with its group, and the label of its position where that is new."""
    named: set[int] = set()
    for group in groups:
        for series in group.series:
            new = series.position not in named
            named.add(series.position)
            label = f"position {_degrees(series.position_rad)}" if new else None
            yield group, series, label


def _volts(series: GroupSeries, branch: str) -> FloatArray:
    """Return the deflections of a branch, V; NaN where there is none."""
    volts = series.up_v if branch == "up" else series.down_v
    return np.array([np.nan if v is None else v for v in volts], dtype=float)


def _slope(group: LoadGroup) -> float:
    """Return the slope of a group's line through zero, V/(N m)."""
    return group.linear_up_down_v_per_nm or group.linear_v_per_nm or math.nan


def _deviations(result: CalibrationResult, range_name: str, prefix: str) -> Picture | None:
    """Draw the deviation from the line against torque, with uncertainty and class."""
    groups = [g for g in result.groups if g.range == range_name]
    groups = [g for g in groups if g.gain_up_down_nm_per_v or g.gain_up_nm_per_v]
    if not groups:
        return None
    figure, (axes,) = new_figure(1, 3.9)
    grade, largest = result.grade, 0.0
    for group in groups:
        _uncertainty_band(axes, result, group)
    for group, series, label in _labelled_series(groups):
        torque = np.array(group.torque_nm)
        full = _slope(group) * torque[-1]
        style = _style(series.position)
        for branch, face in (("up", style["color"]), ("down", COLOURS["paper"])):
            off = 100.0 * (_volts(series, branch) - _slope(group) * torque) / full
            largest = max(largest, float(np.max(np.abs(off[np.isfinite(off)]), initial=0.0)))
            axes.plot(
                _sign(group) * torque,
                off,
                linewidth=0.5,
                markerfacecolor=face,
                label=label if branch == "up" else None,
                zorder=3,
                **style,
            )
    axes.axhline(0.0, color=COLOURS["muted"], linewidth=0.8)
    if grade is not None:
        for group in groups:
            ends = _sign(group) * np.array([0.0, group.torque_nm[-1]])
            # the class limits the deviation to half of it, in percent of the reading
            for limit in (0.5 * grade, -0.5 * grade):
                axes.curve(ends, [0.0, limit], "muted", ":", linewidth=1.2)
    axes.label("applied torque (N·m), clockwise positive", "off the line (% of largest)")
    axes.legend_above(4)
    limits = f" Dotted: limits of the line's deviation in class {grade:g}." if grade else ""
    name, numbers = f"{prefix}-deviation-{range_name}", {"largest": largest, "limits": limits}
    return Picture.drawn(figure, name, "deviation", range=range_name, **numbers)


def _uncertainty_band(axes: Any, result: CalibrationResult, group: LoadGroup) -> None:
    steps = steps_of(result, group)
    cases = [(s.torque_nm, s.increasing_decreasing or s.increasing) for s in steps]
    known = [(torque, case.expanded_nm) for torque, case in cases if case]
    if known:
        torque, expanded = np.array(known).T
        half = 100.0 * expanded / group.torque_nm[-1]
        at = _sign(group) * torque
        axes.fill_between(at, -half, half, color=COLOURS["filtered"], alpha=0.12, linewidth=0)


def range_pictures(
    loads: Loads, experiments: Sequence[ExperimentLine], prefix: str
) -> list[Picture]:
    """Draw the readings of each range, their line, and what is left over."""
    lines = {str(line.id): line for line in experiments}
    pictures = []
    for name, (words, number) in _RANGES.items():
        readings = [r for r in loads.readings if r.range == name and r.experiment in lines]
        if readings:
            pictures.append(_range(readings, lines, words, number, f"{prefix}-{name}"))
    return pictures


def _range(
    readings: Sequence[LoadReading],
    lines: Mapping[str, ExperimentLine],
    words: str,
    number: str,
    name: str,
) -> Picture:
    used = sorted({r.experiment for r in readings})
    fits = {name: (lines[name].gain_nm_per_v, lines[name].intercept_nm) for name in used}
    gain, zero = np.mean(list(fits.values()), axis=0)
    volts = np.array([r.reading_v for r in readings])
    torque = np.array([r.torque_nm for r in readings])
    on_line = [fits[r.experiment][0] * r.reading_v + fits[r.experiment][1] for r in readings]
    off = 1e3 * (torque - np.array(on_line))
    up = np.array([r.series == "up" for r in readings])
    figure, (top, bottom) = new_figure(2, 4.6, ratios=(2.2, 1.0))
    ends = np.array([volts.min(), volts.max()])
    top.curve(ends, gain * ends + zero, "expected", label="mean line")
    bottom.axhline(0.0, color=COLOURS["expected"])
    for axes, x, y in ((top, volts, torque), (bottom, torque, off)):
        for chosen, label in ((up, "loading"), (~up, "unloading")):
            filled = label == "loading"
            style = {"label": label, "markersize": 4.5}
            axes.points(x[chosen], y[chosen], "filtered", filled=filled, **style)
    top.label("amplified bridge output (V)", "applied torque (N·m)")
    top.legend_above()
    bottom.label("applied torque (N·m)", "off its line (mN·m)")
    largest = float(np.max(np.abs(off)))
    share = 1e-3 * largest / float(np.max(np.abs(torque))) if np.any(torque) else 0.0
    return Picture.drawn(
        figure,
        name,
        "range",
        range=words,
        number=number,
        readings=len(readings),
        lines=len(fits),
        gain=gain,
        largest=largest,
        share=100 * share,
    )


def _hysteresis(result: CalibrationResult, prefix: str) -> Picture | None:
    """Draw unloading less loading against torque, and the change of the zero."""
    groups = [g for g in result.groups if g.n_series_up_down]
    # the widest range shows the loop: that of a smaller one lies inside it
    groups = [g for g in groups if g.range == groups[0].range]
    if not groups:
        return None
    figure, (axes,) = new_figure(1, 3.4)
    for group, series, label in _labelled_series(groups):
        before, after = series.zero_before_v, series.zero_after_v
        change = np.nan if before is None or after is None else abs(after - before)
        width = np.abs(_volts(series, "down") - _volts(series, "up"))
        axes.plot(
            _sign(group) * np.array([0.0, *group.torque_nm]),
            1e3 * np.array([change, *width]) / _slope(group),
            linewidth=0.9,
            label=label,
            **{**_style(series.position), "markersize": _SIZE - 0.6},
        )
    axes.label("applied torque (N·m), clockwise positive", "unloading less loading (mN·m)")
    axes.set_ylim(bottom=0.0)
    axes.legend_above(4)
    worst = max((loop.relative for loop in result.hysteresis.values()), default=0.0)
    numbers = {"range": groups[0].range, "worst": 100 * worst}
    return Picture.drawn(figure, f"{prefix}-hysteresis", "hysteresis", **numbers)


def _gains(result: CalibrationResult, prefix: str) -> Picture | None:
    """Draw the gain of each experiment with its own uncertainty, grouped by position."""
    lines = sorted(
        result.experiments,
        key=lambda x: (round(x.position_rad, 4), x.direction, x.range),
    )
    if len(lines) < 2 or result.consistency is None:
        return None
    places = sorted({round(line.position_rad, 4) for line in lines})
    figure, (axes,) = new_figure(1, min(9.0, 1.3 + 0.24 * len(lines)))
    mean = result.gain_nm_per_v.value
    spread = result.consistency * abs(mean)
    axes.axvspan(mean - spread, mean + spread, color=COLOURS["filtered"], alpha=0.12, linewidth=0)
    axes.axvline(mean, color=COLOURS["filtered"])
    for row, line in enumerate(lines):
        style = _style(places.index(round(line.position_rad, 4)))
        face = style["color"] if line.direction == "cw" else "none"
        bar = None if line.gain_std_nm_per_v is None else 2.0 * line.gain_std_nm_per_v
        axes.errorbar(
            line.gain_nm_per_v, row, xerr=bar, markerfacecolor=face, elinewidth=1.0, **style
        )
    names = [f"{_degrees(x.position_rad)} {x.direction} {x.range}" for x in lines]
    axes.set_yticks(range(len(lines)), names)
    axes.invert_yaxis()
    axes.label("gain (N·m/V)", "")
    numbers = {"count": len(lines), "mean": mean, "consistency": 100 * result.consistency}
    return Picture.drawn(figure, f"{prefix}-gains", "gains", **numbers)


def _budget(result: CalibrationResult, prefix: str) -> Picture | None:
    """Draw the standard uncertainties that make up that of the gain."""
    rows = [row for row in result.budget if row.relative_std > 0.0]
    if not rows:
        return None
    rows.sort(key=lambda row: -row.relative_std)
    figure, (axes,) = new_figure(1, 1.2 + 0.26 * len(rows))
    sizes = [1e6 * row.relative_std for row in rows]
    axes.barh(range(len(rows)), sizes, color=COLOURS["filtered"], height=0.62)
    axes.set_yticks(range(len(rows)), [row.name for row in rows])
    axes.set_xscale("log")
    # plain numbers: powers of ten would need a formula typesetter
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(lambda _value, _: "")
    axes.set_xlim(left=min(0.5, 0.5 * min(sizes)))
    axes.invert_yaxis()
    axes.label("relative standard uncertainty of the gain (ppm)", "")
    first, share = rows[0].name, 100 * (rows[0].share or 0.0)
    words = {"first": first, "First": first.capitalize(), "share": share}
    return Picture.drawn(figure, f"{prefix}-budget", "budget", **words)


def _sequence(result: CalibrationResult, prefix: str) -> Picture | None:
    """Draw the applied torque against time, preloads marked."""
    rows: Sequence[SequenceEntry | ReadingRecord] = result.sequence or result.readings
    told = [r for r in rows if r.time_s is not None and r.torque_nm is not None]
    if len(told) < 2:
        return None
    time = np.array([r.time_s for r in told]) / 60.0
    torque = np.array([r.torque_nm for r in told])
    kinds = np.array([r.kind for r in told])
    figure, (axes,) = new_figure(1, 2.8)
    axes.step(time, torque, where="mid", color=COLOURS["measured"], linewidth=0.8)
    for kind, label, colour, mark, size in (
        ("reading", "readings", "filtered", "o", 2.6),
        ("zero", "zeros", "lowpass", "o", 2.6),
        ("preload", "preloads", "expected", "^", 4.0),
        ("shunt", "shunt", "before", "s", 4.0),
    ):
        at = kinds == kind
        if at.any():
            axes.curve(time[at], torque[at], colour, mark, markersize=size, label=label)
    axes.label("time (min)", "applied torque (N·m)")
    axes.legend_above(4)
    preloads, minutes = int(((kinds == "preload") & (torque != 0.0)).sum()), time.max() - time.min()
    numbers = {"loads": len(told), "preloads": preloads, "minutes": minutes}
    return Picture.drawn(figure, f"{prefix}-course", "course", **numbers)


def _top_drift(result: CalibrationResult, prefix: str) -> Picture | None:
    """Draw how fast the readings under the largest load drifted, against time."""
    lines = {line.id: line for line in result.experiments}
    known = sorted({round(line.position_rad, 4) for line in lines.values()})
    widest = "full" if any(line.range == "full" for line in lines.values()) else "low"
    own = [
        r for r in result.readings if r.experiment in lines and lines[r.experiment].range == widest
    ]
    top = max((abs(r.torque_nm) for r in own), default=0.0)
    scale = 6e4 * abs(result.gain_nm_per_v.value)
    chosen = [
        (r, r.time_s / 60.0, scale * r.slope_v_s)
        for r in own
        if abs(r.torque_nm) >= _TOP * top > 0.0 and r.slope_v_s is not None and r.time_s is not None
    ]
    if not chosen:
        return None
    figure, (axes,) = new_figure(1, 2.8)
    for r, minutes, drift in chosen:
        style = _style(known.index(round(lines[r.experiment].position_rad, 4)))
        bar = _slope_bar(r, result.average_s, scale)
        axes.errorbar(minutes, drift, yerr=bar, ls="none", elinewidth=0.9, **style)
    axes.axhline(0.0, color=COLOURS["muted"], linewidth=0.8)
    axes.label("time (min)", "drift at the top step (mN·m/min)")
    worst = max(abs(drift) for _, _, drift in chosen)
    bars = " Bars: two standard uncertainties of white noise over the average."
    numbers = {"worst": worst, "bars": bars if result.average_s else ""}
    return Picture.drawn(figure, f"{prefix}-top", "top", **numbers)


def _slope_bar(reading: ReadingRecord, average_s: float | None, scale: float) -> float | None:
    """Return two standard uncertainties of a reading's slope; None where they are not known."""
    spread, n = reading.reading_std_v, reading.n_samples
    if not (average_s and spread is not None and n):
        return None
    # least squares over n equal steps: s sqrt(12 / n) over the whole time
    return 2.0 * scale * float(spread) * math.sqrt(12.0 / n) / average_s
