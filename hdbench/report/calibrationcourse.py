"""Figures of the calibration record: budget, course of the run, readings at the top step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hdbench.report.calibrationfigures import MARKS, position_colour
from hdbench.report.canvas import COLOURS, draw_svg, label_axes, legend_above, new_figure
from hdbench.report.elements import Picture

__all__ = ["budget_picture", "sequence_picture", "top_picture"]

Result = Mapping[str, Any]
# a reading belongs to the top step when its torque is this share of its experiment's largest
_TOP = 0.98


def budget_picture(result: Result, prefix: str) -> Picture | None:
    """Draw the standard uncertainties that make up that of the gain."""
    rows = [row for row in result.get("budget", ()) if row["relative_std"] > 0.0]
    if not rows:
        return None
    rows = sorted(rows, key=lambda row: -row["relative_std"])
    figure, (axes,) = new_figure(1, 1.2 + 0.26 * len(rows))
    sizes = [1e6 * row["relative_std"] for row in rows]
    axes.barh(range(len(rows)), sizes, color=COLOURS["filtered"], height=0.62)
    axes.set_yticks(range(len(rows)), [row["name"] for row in rows])
    axes.set_xscale("log")
    # plain numbers: powers of ten would need a formula typesetter
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(lambda _value, _: "")
    axes.set_xlim(left=min(0.5, 0.5 * min(sizes)))
    axes.invert_yaxis()
    label_axes(axes, "relative standard uncertainty of the gain (ppm)", "")
    caption = (
        "Standard uncertainties of the gain by source, logarithmic. "
        f"{rows[0]['name'].capitalize()} is {100 * rows[0]['share']:.0f} % of the variance. "
        "What is not declared is not drawn."
    )
    alt = f"Bars of relative standard uncertainties; the largest is {rows[0]['name']}."
    return Picture("Budget", caption, alt, draw_svg(figure, f"{prefix}-budget", alt))


def sequence_picture(result: Result, prefix: str) -> Picture | None:
    """Draw the applied torque against time, preloads marked."""
    rows = list(result.get("sequence", ())) or list(result.get("readings", ()))
    told = [r for r in rows if r["time_s"] is not None and r["torque_nm"] is not None]
    if len(told) < 2:
        return None
    time = np.array([r["time_s"] for r in told]) / 60.0
    torque = np.array([r["torque_nm"] for r in told])
    kinds = np.array([r["kind"] for r in told])
    figure, (axes,) = new_figure(1, 2.8)
    axes.step(time, torque, where="mid", color=COLOURS["measured"], linewidth=0.8)
    for kind, colour, mark, size in (
        ("reading", "filtered", "o", 2.6),
        ("zero", "lowpass", "o", 2.6),
        ("preload", "expected", "^", 4.0),
        ("shunt", "before", "s", 4.0),
    ):
        chosen = kinds == kind
        if chosen.any():
            axes.plot(
                time[chosen],
                torque[chosen],
                linestyle="none",
                marker=mark,
                markersize=size,
                color=COLOURS[colour],
                label=f"{kind}s" if kind != "shunt" else "shunt",
            )
    label_axes(axes, "time (min)", "applied torque (N·m)")
    legend_above(axes, 4)
    n_preloads = int(((kinds == "preload") & (torque != 0.0)).sum())
    caption = (
        f"Applied torque in the order of the run: {len(told)} loads, {n_preloads} of them "
        f"preloads, over {time.max() - time.min():.0f} min."
    )
    alt = f"Applied torque against time over {time.max() - time.min():.0f} minutes."
    return Picture(
        "Course of the calibration", caption, alt, draw_svg(figure, f"{prefix}-course", alt)
    )


def top_picture(result: Result, prefix: str) -> Picture | None:
    """Draw the readings under the largest load against time."""
    places = {line["id"]: line["position_rad"] for line in result.get("experiments", ())}
    known = sorted({round(p, 4) for p in places.values()})
    ranges = {line["id"]: line["range"] for line in result.get("experiments", ())}
    widest = "full" if "full" in ranges.values() else "low"
    own = [r for r in result.get("readings", ()) if ranges.get(r["experiment"]) == widest]
    top = max((abs(r["torque_nm"]) for r in own), default=0.0)
    chosen = [
        r
        for r in own
        if abs(r["torque_nm"]) >= _TOP * top > 0.0
        and r["slope_v_s"] is not None
        and r["time_s"] is not None
    ]
    if not chosen:
        return None
    figure, (axes,) = new_figure(1, 2.8)
    gain = abs(float(result["gain_nm_per_v"]["value"]))
    for r in chosen:
        place = known.index(round(places[r["experiment"]], 4))
        axes.errorbar(
            r["time_s"] / 60.0,
            6e4 * gain * r["slope_v_s"],
            yerr=_slope_bar(r, result.get("average_s"), 6e4 * gain),
            linestyle="none",
            elinewidth=0.9,
            color=position_colour(place),
            marker=MARKS[place % len(MARKS)],
            markersize=4.2,
        )
    axes.axhline(0.0, color=COLOURS["muted"], linewidth=0.8)
    label_axes(axes, "time (min)", "drift at the top step (mN·m/min)")
    worst = max(abs(6e4 * gain * r["slope_v_s"]) for r in chosen)
    caption = (
        "How fast the reading still moved while it was averaged under the largest load: creep and "
        f"settling. Largest: {worst:.2f} mN·m per minute. One colour and mark for each position."
    )
    alt = f"Drift under the largest load against time; the largest is {worst:.2f} mN m per minute."
    if result.get("average_s"):
        caption += " Bars: two standard uncertainties of white noise over the average."
    title = "Creep: drift of the readings at the top step"
    return Picture(title, caption, alt, draw_svg(figure, f"{prefix}-top", alt))


def _slope_bar(reading: Mapping[str, Any], average_s: Any, scale: float) -> float | None:
    """Return two standard uncertainties of a reading's slope; None where they are not known."""
    spread, n = reading["reading_std_v"], reading["n_samples"]
    if not (average_s and spread is not None and n):
        return None
    # least squares over n equal steps: s sqrt(12 / n) over the whole time
    return 2.0 * scale * float(spread) * float(np.sqrt(12.0 / n)) / float(average_s)
