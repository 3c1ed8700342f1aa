"""What a log can tell, in a report: its channels, what was found, and its bands as a picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hdbench.report.canvas import COLOURS, draw_svg, label_axes, legend_above, new_figure, trend
from hdbench.report.elements import Picture, Table
from hdbench.report.numbers import DASH, unit_words

__all__ = ["picture", "tables"]

_CHANNEL_HEAD = (
    "channel", "unit", "rate (Hz)", "bandwidth (Hz)", "step", "noise", "held (%)", "made of",
)  # fmt: skip
_FOUND_HEAD = ("what", "channel", "size", "so")
# height of a bar and of what stands around all of them, inch; of the spectra
_BAR_IN, _AROUND_IN, _SPECTRA_IN = 0.3, 0.9, 2.6
# colours of the spectra, in turn: more curves than these would hide each other
_CURVES = ("measured", "filtered", "expected", "lowpass")
# decades below the strongest part that are drawn: 20 bits of a sensor are 12
_DECADES = 14.0


def _shown(value: float | None, form: str = ".4g") -> str:
    return DASH if value is None else format(value, form)


def tables(inspection: Mapping[str, Any]) -> tuple[Table, ...]:
    """List what was found, what the motion leaves open, and every channel."""
    limits = (inspection.get("coverage") or {}).get("limits", ())
    found = tuple(
        (one["name"], one["channel"] or DASH, one["detail"], one["consequence"])
        for one in (*inspection["findings"], *limits)
    )
    rows = tuple(
        (
            one["name"],
            unit_words(one["unit"]) or DASH,
            _shown(one["rate_hz"]),
            _shown(one["bandwidth_hz"]),
            _shown(one["resolution"], ".3g"),
            _shown(one["noise"], ".2g"),
            _shown(100.0 * one["held_share"], ".2g"),
            one["derived_from"] or DASH,
        )
        for one in inspection["channels"]
    )
    stamps = inspection["sampling"]
    note = f"{stamps['rows']} rows without a time."
    if stamps["median_s"] is not None:
        note = (
            f"{stamps['rows']} rows at {stamps['rate_hz']:.6g} Hz, steps scatter by "
            f"{100.0 * stamps['jitter_share']:.2g} %, {len(stamps['gaps'])} gaps."
        )
    every = (
        Table("What the log cannot tell", _FOUND_HEAD, found, wide=True, stacked=True),
        Table("Channels of the log", _CHANNEL_HEAD, rows, note, wide=True, folded=True),
    )
    return tuple(table for table in every if table.rows)


def picture(
    inspection: Mapping[str, Any], prefix: str, spectra: Mapping[str, Any] | None = None
) -> Picture | None:
    """Draw up to where each channel holds something, and the spectra where they are known."""
    banded = [one for one in inspection["channels"] if one["bandwidth_hz"]]
    if not banded:
        return None
    drawn = [one for one in banded if spectra and one["name"] in spectra][: len(_CURVES)]
    bars_in = _AROUND_IN + _BAR_IN * len(banded)
    heights = (bars_in, _SPECTRA_IN) if drawn else (bars_in,)
    figure, axes = new_figure(len(heights), sum(heights), ratios=heights)
    bars = axes[0]
    top = max(0.5 * one["rate_hz"] for one in banded)
    lowest = min(0.01 * top, 0.5 * min(one["bandwidth_hz"] for one in banded))
    for row, one in enumerate(reversed(banded)):
        whole, held = 0.5 * one["rate_hz"], one["bandwidth_hz"]
        bars.barh(row, whole - lowest, left=lowest, height=0.6, color=COLOURS["grid"])
        bars.barh(row, held - lowest, left=lowest, height=0.6, color=COLOURS["measured"])
    bars.set_xscale("log")
    bars.set_xlim(lowest, 1.1 * top)
    bars.set_yticks(range(len(banded)), [one["name"] for one in reversed(banded)])
    bars.xaxis.set_major_formatter("{x:g}")
    label_axes(bars, "frequency (Hz)", "")
    if drawn and spectra:
        curves = axes[1]
        for one, colour in zip(drawn, _CURVES, strict=False):
            seen = spectra[one["name"]]
            share = np.maximum(seen.density / seen.density.max(), 10.0**-_DECADES)
            trend(curves, seen.frequency_hz, np.log10(share), colour, label=one["name"])
        curves.set_xscale("log")
        curves.xaxis.set_major_formatter("{x:g}")
        label_axes(curves, "frequency (Hz)", "density, decades")
        legend_above(curves, 2)
    limited = [one["name"] for one in banded if one["bandwidth_hz"] < 0.49 * one["rate_hz"]]
    words = f"Limited below half their rate: {', '.join(limited)}." if limited else (
        "Every channel holds noise or signal up to half its rate."
    )  # fmt: skip
    caption = (
        "Bars: up to which frequency each channel holds more than rounding, in full colour, of "
        f"what its rate allows. {words}"
    )
    if drawn:
        caption += " Curves: density over the strongest part, lines left out."
    svg = draw_svg(figure, f"{prefix}-bands", caption)
    return Picture("What the channels can tell", caption, caption, svg)
