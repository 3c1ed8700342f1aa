"""Figures of a calibration: readings and line, loading filled, unloading open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hdbench.records import LoadReading, Loads
from hdbench.report.canvas import COLOURS, draw_svg, label_axes, legend_above, new_figure
from hdbench.report.elements import Picture

__all__ = ["calibration_pictures", "number_of"]

_RANGES = {"low": ("low-range", "6"), "full": ("full-range", "7")}


def calibration_pictures(
    loads: Loads, experiments: Sequence[Mapping[str, Any]], prefix: str
) -> tuple[Picture, ...]:
    """Draw the readings of each range, their line, and what is left over."""
    lines = {str(line["id"]): line for line in experiments}
    pictures = []
    for name, (words, number) in _RANGES.items():
        readings = [r for r in loads.readings if r.range == name and r.experiment in lines]
        if readings:
            pictures.append(_range_picture(readings, lines, words, number, f"{prefix}-{name}"))
    return tuple(pictures)


def number_of(value: Any) -> float:
    """Return the value of a number with or without an uncertainty."""
    return float(value["value"] if isinstance(value, Mapping) else value)


def _range_picture(
    readings: Sequence[LoadReading],
    lines: Mapping[str, Mapping[str, Any]],
    words: str,
    number: str,
    name: str,
) -> Picture:
    volts = np.array([r.reading_v for r in readings])
    torque = np.array([r.torque_nm for r in readings])
    up = np.array([r.series == "up" for r in readings])
    used = sorted({r.experiment for r in readings})
    gain = float(np.mean([number_of(lines[key]["gain_nm_per_v"]) for key in used]))
    zero = float(np.mean([number_of(lines[key]["intercept_nm"]) for key in used]))
    off = 1e3 * (torque - np.array([_on_line(lines[r.experiment], r) for r in readings]))
    figure, (top, bottom) = new_figure(2, 4.6, ratios=(2.2, 1.0))
    ends = np.array([volts.min(), volts.max()])
    top.plot(ends, gain * ends + zero, color=COLOURS["expected"], label="mean line")
    _markers(top, volts, torque, up)
    label_axes(top, "amplified bridge output (V)", "applied torque (N·m)")
    legend_above(top)
    bottom.axhline(0.0, color=COLOURS["expected"])
    _markers(bottom, torque, off, up)
    label_axes(bottom, "applied torque (N·m)", "off its line (mN·m)")
    largest = float(np.max(np.abs(off)))
    share = 1e-3 * largest / float(np.max(np.abs(torque))) if np.any(torque) else 0.0
    caption = (
        f"{len(readings)} readings of {len(used)} {words} experiments against the applied torque, "
        f"with their mean line of {gain:.3f} N·m/V. Below: how far each reading stands off the "
        f"line of its own experiment; the largest distance is {largest:.1f} mN·m, "
        f"{100 * share:.2f} % of the largest torque. Filled: loading. Open: unloading; a gap "
        "between the two is hysteresis."
    )
    alt = (
        f"Scatter of applied torque over bridge voltage for {words} loading with a straight line "
        f"of slope {gain:.3f} newton metres per volt; deviations stay within {largest:.1f} "
        "millinewton metres."
    )
    title = f"Calibration, {words} loading (after figure {number})"
    return Picture(title, caption, alt, draw_svg(figure, name, alt))


def _on_line(line: Mapping[str, Any], reading: LoadReading) -> float:
    """Return the torque that the experiment's line gives at a reading, N m."""
    return number_of(line["gain_nm_per_v"]) * reading.reading_v + number_of(line["intercept_nm"])


def _markers(axes: Any, x: Any, y: Any, up: Any) -> None:
    style = {"linestyle": "none", "marker": "o", "markersize": 4.5, "zorder": 3}
    blue = COLOURS["filtered"]
    axes.plot(x[up], y[up], color=blue, markeredgecolor=blue, label="loading", **style)
    axes.plot(
        x[~up],
        y[~up],
        markerfacecolor=COLOURS["paper"],
        markeredgecolor=blue,
        label="unloading",
        **style,
    )
