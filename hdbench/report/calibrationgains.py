"""Figures of the calibration record: hysteresis, gain of each experiment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hdbench.report.calibrationfigures import (
    MARKS,
    SIZE,
    branch_volts,
    direction_sign,
    line_slope,
    position_colour,
    position_degrees,
)
from hdbench.report.canvas import COLOURS, draw_svg, label_axes, legend_above, new_figure
from hdbench.report.elements import Picture

__all__ = ["gain_picture", "hysteresis_picture"]

Result = Mapping[str, Any]


def hysteresis_picture(result: Result, prefix: str) -> Picture | None:
    """Draw unloading less loading against torque, and the change of the zero."""
    groups = [g for g in result.get("groups", ()) if g["n_series_up_down"]]
    # the widest range shows the loop: that of a smaller one lies inside it
    groups = [g for g in groups if g["range"] == groups[0]["range"]]
    if not groups:
        return None
    figure, (axes,) = new_figure(1, 3.4)
    named: set[int] = set()
    for group in groups:
        for series in group["series"]:
            _width(axes, group, series, named)
    label_axes(axes, "applied torque (N·m), clockwise positive", "unloading less loading (mN·m)")
    axes.set_ylim(bottom=0.0)
    legend_above(axes)
    worst = max((loop["relative"] for loop in result["hysteresis"].values()), default=0.0)
    caption = (
        "Size of the difference between unloading and loading at each step of the "
        f"{groups[0]['range']} range, and at 0 N·m that of "
        "the zeros before and after (f0). A lens that is 0 at the largest torque is the "
        "material's; a constant part is friction. Largest at equal torque: "
        f"{100 * worst:.2f} % of the largest."
    )
    alt = (
        "Difference between unloading and loading against torque for each series; the largest is "
        f"{100 * worst:.2f} percent of the largest torque."
    )
    name = f"{prefix}-hysteresis"
    return Picture("Hysteresis and zero", caption, alt, draw_svg(figure, name, alt))


def _width(axes: Any, group: Mapping[str, Any], series: Mapping[str, Any], named: set[int]) -> None:
    torque, slope = np.array(group["torque_nm"]), line_slope(group)
    place = int(series["position"])
    width = np.abs(branch_volts(series, "down") - branch_volts(series, "up"))
    zero = np.nan
    if series["zero_before_v"] is not None and series["zero_after_v"] is not None:
        zero = abs(series["zero_after_v"] - series["zero_before_v"])
    label = None if place in named else f"position {position_degrees(series['position_rad'])}"
    named.add(place)
    axes.plot(
        direction_sign(group) * np.concatenate([[0.0], torque]),
        1e3 * np.concatenate([[zero], width]) / slope,
        color=position_colour(place),
        marker=MARKS[place % len(MARKS)],
        markersize=SIZE - 0.6,
        linewidth=0.9,
        label=label,
    )


def gain_picture(result: Result, prefix: str) -> Picture | None:
    """Draw the gain of each experiment with its own uncertainty, grouped by position."""
    lines = sorted(
        result.get("experiments", ()),
        key=lambda x: (round(x["position_rad"], 4), x["direction"], x["range"]),
    )
    if len(lines) < 2:
        return None
    places = sorted({round(line["position_rad"], 4) for line in lines})
    figure, (axes,) = new_figure(1, min(9.0, 1.3 + 0.24 * len(lines)))
    mean = float(result["gain_nm_per_v"]["value"])
    spread = float(result["consistency"]) * abs(mean)
    axes.axvspan(mean - spread, mean + spread, color=COLOURS["filtered"], alpha=0.12, linewidth=0)
    axes.axvline(mean, color=COLOURS["filtered"])
    for row, line in enumerate(lines):
        _gain(axes, row, line, places.index(round(line["position_rad"], 4)))
    axes.set_yticks(
        range(len(lines)),
        [f"{position_degrees(x['position_rad'])} {x['direction']} {x['range']}" for x in lines],
    )
    axes.invert_yaxis()
    label_axes(axes, "gain (N·m/V)", "")
    caption = (
        "Gain of each experiment with two standard uncertainties of its own line. Line: their mean "
        f"of {mean:.4f} N·m/V; band: their standard deviation about it, "
        f"{100 * float(result['consistency']):.2f} %. Bars far shorter than the scatter say that "
        "the position, not the fit, decides. Filled: clockwise."
    )
    alt = f"Gains of {len(lines)} experiments by position around their mean of {mean:.3f}."
    return Picture(
        "Gain of each experiment", caption, alt, draw_svg(figure, f"{prefix}-gains", alt)
    )


def _gain(axes: Any, row: int, line: Mapping[str, Any], place: int) -> None:
    colour = position_colour(place)
    axes.errorbar(
        line["gain_nm_per_v"],
        row,
        xerr=2.0 * line["gain_std_nm_per_v"],
        color=colour,
        marker=MARKS[place % len(MARKS)],
        markersize=SIZE,
        markerfacecolor=colour if line["direction"] == "cw" else "none",
        elinewidth=1.0,
    )
