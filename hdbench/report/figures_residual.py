"""Figures of a diagnosis: what the simulation misses, before and after it was extended."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from hdbench.records import FloatArray
from hdbench.report.canvas import (
    COLOURS,
    draw_svg,
    label_axes,
    legend_above,
    new_figure,
    trend,
)
from hdbench.report.decimate import min_max
from hdbench.report.elements import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["residual_pictures"]

Columns = Mapping[str, FloatArray]
# samples in a close-up: enough to see a ripple, few enough to tell the dots
_CLOSE_SAMPLES = 160
_PLACES = {
    "motor_order": ("motor order (cycles per motor turn)", "motor order", ""),
    "frequency_hz": ("frequency (Hz)", "frequency", " Hz"),
    "output_order": ("output order (cycles per output turn)", "output order", ""),
}


def residual_pictures(
    columns: Columns, spectra: Mapping[str, Columns], prefix: str
) -> tuple[Picture, ...]:
    """Draw the comparison, the residual over time, and its spectra."""
    drawn = [_comparison(columns, f"{prefix}-simulated"), _residual(columns, f"{prefix}-residual")]
    for name, table in sorted(spectra.items(), key=lambda item: _rank(item[1])):
        picture = _spectrum(table, f"{prefix}-{name.replace('_', '-')}")
        if picture is not None:
            drawn.append(picture)
    return tuple(drawn)


def _rank(table: Columns) -> int:
    return next((i for i, key in enumerate(_PLACES) if key in table), len(_PLACES))


def _comparison(columns: Columns, name: str) -> Picture:
    time = columns["time_s"]
    figure, (whole, before, after) = new_figure(3, 5.6, ratios=(1.0, 1.0, 1.0))
    trend(whole, time, columns["measured_nm"], "measured", width=0.7, label="measured")
    trend(whole, time, columns["simulated_nm"], "expected", width=0.7, label="simulated")
    trend(whole, time, columns["extended_nm"], "after", width=0.7, label="extended")
    legend_above(whole)
    middle = len(time) // 2
    cut = slice(middle, min(middle + _CLOSE_SAMPLES, len(time)))
    for axes, key, colour, words in (
        (before, "simulated_nm", "expected", "close-up: measured (dots) and simulated"),
        (after, "extended_nm", "after", "close-up: measured (dots) and extended simulation"),
    ):
        axes.plot(
            time[cut],
            columns["measured_nm"][cut],
            color=COLOURS["measured"],
            linestyle="none",
            marker="o",
            markersize=2.2,
        )
        axes.plot(time[cut], columns[key][cut], color=COLOURS[colour])
        label_axes(axes, None, "torque (N·m)", words)
    label_axes(whole, None, "torque (N·m)")
    after.set_xlabel("time (s)")
    caption = (
        "Measured torque against the simulation of the same motion: as the model was handed in "
        "(middle) and with the causes that were found (below). Where the line runs through the "
        "dots, the simulation explains the measurement."
    )
    alt = "Measured torque over time with the simulated torque, before and after the extension."
    return Picture("Measured against simulated", caption, alt, draw_svg(figure, name, alt))


def _rms(values: FloatArray, masked: FloatArray) -> float:
    good = values[np.isfinite(values) & ~(masked > 0.0)]
    return float(np.sqrt(np.mean(good**2))) if len(good) else 0.0


def _residual(columns: Columns, name: str) -> Picture:
    time = columns["time_s"]
    masked = columns.get("masked", np.zeros(len(time)))
    before, after = columns["residual_before_nm"], columns["residual_after_nm"]
    figure, (top, bottom) = new_figure(2, 4.2, share_x=True)
    bottom.sharey(top)
    trend(top, time, before, "before", width=0.7)
    trend(bottom, time, after, "after", width=0.7)
    rms = _rms(before, masked), _rms(after, masked)
    label_axes(top, None, "residual (N·m)", f"before: {rms[0]:.3g} N·m rms")
    label_axes(bottom, "time (s)", "residual (N·m)", f"after: {rms[1]:.3g} N·m rms")
    for axes in (top, bottom):
        _shade(axes, time, masked)
    hidden = int(np.count_nonzero(masked > 0.0))
    note = f" Shaded: {hidden} samples that were left out as faulty." if hidden else ""
    caption = (
        f"What the simulation misses, on one scale: {rms[0]:.3g} N·m rms before, {rms[1]:.3g} "
        f"N·m rms after it was extended by the causes found.{note}"
    )
    alt = (
        f"Residual torque over time before and after the model was extended; its rms falls from "
        f"{rms[0]:.3g} to {rms[1]:.3g} newton metres."
    )
    return Picture("Residual before and after", caption, alt, draw_svg(figure, name, alt))


def _shade(axes: Axes, time: FloatArray, masked: FloatArray) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], (masked > 0.0).astype(np.int8), [0]))))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        axes.axvspan(time[start], time[stop - 1], color=COLOURS["expected"], alpha=0.2, linewidth=0)


def _spectrum(table: Columns, name: str) -> Picture | None:
    place = next((key for key in _PLACES if key in table), None)
    before = next((key for key in table if "before" in key), None)
    after = next((key for key in table if "after" in key), None)
    if place is None or before is None or after is None:
        return None
    label, words, unit = _PLACES[place]
    figure, (axes,) = new_figure(1, 3.1)
    x = table[place]
    for key, colour, when in ((before, "before", "before"), (after, "after", "after")):
        few_x, few_y = min_max(x, table[key])
        axes.plot(few_x, few_y, color=COLOURS[colour], linewidth=1.0, label=when)
    axes.set_ylim(bottom=0.0)
    label_axes(axes, label, "amplitude (N·m)")
    legend_above(axes)
    at = int(np.nanargmax(table[before]))
    left = float(table[after][at])
    rest = f"{left:.3g} N·m are left there." if left > 0.0 else "nothing is left there."
    caption = (
        f"Amplitude of the residual over {words}. Before: the highest peak is "
        f"{float(table[before][at]):.3g} N·m at {float(x[at]):.4g}{unit}; after the extension "
        f"{rest}"
    )
    alt = (
        f"Residual amplitude over {words}; the peak at {float(x[at]):.4g}{unit} falls from "
        f"{float(table[before][at]):.3g} to {float(table[after][at]):.3g} newton metres."
    )
    title = f"Residual over {words}"
    return Picture(title, caption, alt, draw_svg(figure, name, alt))
