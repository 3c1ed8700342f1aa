"""Figure of the calibration record that is looked at first: deviation from the line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hdbench.records import FloatArray
from hdbench.report.canvas import COLOURS, draw_svg, label_axes, legend_above, new_figure
from hdbench.report.elements import Picture

__all__ = [
    "MARKS",
    "SIZE",
    "branch_volts",
    "deviation_picture",
    "direction_sign",
    "line_slope",
    "position_colour",
    "position_degrees",
]

Result = Mapping[str, Any]
# one colour and one mark for each position: told apart without seeing colours as well
_COLOURS = ("filtered", "expected", "lowpass", "before", "measured", "ink")
MARKS = ("o", "s", "^", "D", "v", "P", "X", "<")
SIZE = 4.2


def position_colour(position: int) -> str:
    """Return the colour of a position's readings."""
    return COLOURS[_COLOURS[position % len(_COLOURS)]]


def direction_sign(group: Mapping[str, Any]) -> float:
    """Return 1 for a clockwise group, -1 for an anticlockwise one."""
    return 1.0 if group["direction"] == "cw" else -1.0


def position_degrees(position_rad: float) -> str:
    """Return a position in degrees, with their sign."""
    return f"{math.degrees(position_rad):.4g}°"


def deviation_picture(result: Result, range_name: str, prefix: str) -> Picture | None:
    """Draw the deviation from the line against torque, with uncertainty and class."""
    groups = [g for g in result.get("groups", ()) if g["range"] == range_name]
    groups = [g for g in groups if g["gain_up_down_nm_per_v"] or g["gain_up_nm_per_v"]]
    if not groups:
        return None
    figure, (axes,) = new_figure(1, 3.9)
    named: set[int] = set()
    largest = 0.0
    for group in groups:
        _band(axes, result, group)
        largest = max(largest, _deviations(axes, group, named))
    axes.axhline(0.0, color=COLOURS["muted"], linewidth=0.8)
    grade = _class_lines(axes, result, groups)
    label_axes(axes, "applied torque (N·m), clockwise positive", "off the line (% of largest)")
    legend_above(axes)
    limits = f" Dotted: limits of the line's deviation in class {grade:g}." if grade else ""
    caption = (
        f"Deflection less the line through zero of its direction, {range_name} range, in percent "
        "of the largest deflection. Filled: loading. Open: unloading. One colour and mark for each "
        "position. Band: expanded uncertainty of a step about the line." + limits
    )
    alt = (
        f"Deviation of calibration readings from a straight line against torque, {range_name} "
        f"range; the largest is {largest:.2f} percent of the largest deflection."
    )
    name = f"{prefix}-deviation-{range_name}"
    title = f"Deviation from the line, {range_name} range"
    return Picture(title, caption, alt, draw_svg(figure, name, alt))


def branch_volts(series: Mapping[str, Any], branch: str) -> FloatArray:
    """Return the deflections of a branch, V; NaN where there is none."""
    return np.array([np.nan if v is None else v for v in series[f"{branch}_v"]], dtype=float)


def line_slope(group: Mapping[str, Any]) -> float:
    """Return the slope of a group's line through zero, V/(N m)."""
    return float(group["linear_up_down_v_per_nm"] or group["linear_v_per_nm"])


def _deviations(axes: Any, group: Mapping[str, Any], named: set[int]) -> float:
    torque, slope = np.array(group["torque_nm"]), line_slope(group)
    full = slope * torque[-1]
    largest = 0.0
    for series in group["series"]:
        place = int(series["position"])
        colour, mark = position_colour(place), MARKS[place % len(MARKS)]
        for branch, face in (("up", colour), ("down", COLOURS["paper"])):
            off = 100.0 * (branch_volts(series, branch) - slope * torque) / full
            label = None
            if branch == "up" and place not in named:
                named.add(place)
                label = f"position {position_degrees(series['position_rad'])}"
            axes.plot(
                direction_sign(group) * torque,
                off,
                color=colour,
                linewidth=0.5,
                marker=mark,
                markersize=SIZE,
                markerfacecolor=face,
                markeredgecolor=colour,
                markeredgewidth=1.0,
                label=label,
                zorder=3,
            )
            known = off[np.isfinite(off)]
            largest = max(largest, float(np.max(np.abs(known)))) if len(known) else largest
    return largest


def _steps(result: Result, group: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    keys = ("direction", "range", "loading", "arm_length_m")
    return [s for s in result["steps"] if all(s[k] == group[k] for k in keys)]


def _band(axes: Any, result: Result, group: Mapping[str, Any]) -> None:
    rows = [(s, s["increasing_decreasing"] or s["increasing"]) for s in _steps(result, group)]
    rows = [(s, case) for s, case in rows if case]
    if not rows:
        return
    torque = np.array([s["torque_nm"] for s, _ in rows])
    half = np.array([100.0 * case["expanded_nm"] / group["torque_nm"][-1] for _, case in rows])
    at = direction_sign(group) * torque
    axes.fill_between(at, -half, half, color=COLOURS["filtered"], alpha=0.12, linewidth=0)


def _class_lines(axes: Any, result: Result, groups: Sequence[Mapping[str, Any]]) -> float | None:
    grade = result.get("class")
    if grade is None:
        return None
    for group in groups:
        torque = np.array([0.0, group["torque_nm"][-1]])
        # the class limits the deviation to half of it, in percent of the reading
        limit = 0.5 * float(grade) * torque / torque[-1]
        for side in (1.0, -1.0):
            axes.plot(
                direction_sign(group) * torque,
                side * limit,
                ":",
                color=COLOURS["muted"],
                linewidth=1.2,
            )
    return float(grade)
