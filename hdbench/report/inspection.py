"""Inspection of a log in a report: its channels, what was found, and its bands as a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hdbench.report.canvas import COLOURS, Panel, new_figure
from hdbench.report.pagemodel import Picture, Table

# height of a bar and of what stands around all of them, inch; of the spectra
_BAR_IN, _AROUND_IN, _SPECTRA_IN = 0.3, 0.9, 2.6
# colours of the spectra, in turn: more curves than these would hide each other
_CURVES = ("measured", "filtered", "expected", "lowpass")
# decades below the strongest part that are drawn: 20 bits of a sensor are 12
_DECADES = 14.0


def tables(inspection: Mapping[str, Any]) -> tuple[Table, ...]:
    """List what was found, what the motion leaves open, and every channel."""
    limits = (inspection.get("coverage") or {}).get("limits", ())
    stamps = inspection["sampling"]
    note = f"{stamps['rows']} rows without a time."
    if stamps["median_s"] is not None:
        note = (
            f"{stamps['rows']} rows at {stamps['rate_hz']:.6g} Hz, steps scatter by "
            f"{100.0 * stamps['jitter_share']:.2g} %, {len(stamps['gaps'])} gaps."
        )
    return Table.filled(
        Table.told("findings", (*inspection["findings"], *limits)),
        Table.told("channels", inspection["channels"], note),
    )


def picture(
    inspection: Mapping[str, Any], prefix: str, spectra: Mapping[str, Any] | None = None
) -> Picture | None:
    """Draw up to where each channel holds something, and the spectra where they are known."""
    banded = [one for one in inspection["channels"] if one["bandwidth_hz"]]
    if not banded:
        return None
    spectra = spectra or {}
    drawn = [(one["name"], spectra[one["name"]]) for one in banded if one["name"] in spectra]
    bars_in = _AROUND_IN + _BAR_IN * len(banded)
    heights = (bars_in, _SPECTRA_IN) if drawn else (bars_in,)
    figure, axes = new_figure(len(heights), sum(heights), ratios=heights)
    _bars(axes[0], banded)
    axes[0].label("frequency (Hz)", "")
    limited = [one["name"] for one in banded if one["bandwidth_hz"] < 0.49 * one["rate_hz"]]
    words = "Every channel holds noise or signal up to half its rate."
    if limited:
        words = f"Limited below half their rate: {', '.join(limited)}."
    if drawn:
        for (name, seen), colour in zip(drawn, _CURVES, strict=False):
            share = np.maximum(seen.density / seen.density.max(), 10.0**-_DECADES)
            axes[1].curve(seen.frequency_hz, np.log10(share), colour, label=name)
        axes[1].set_xscale("log")
        axes[1].xaxis.set_major_formatter("{x:g}")
        axes[1].label("frequency (Hz)", "density, decades")
        axes[1].legend_above(2)
        words += " Curves: density over the strongest part, lines left out."
    return Picture.drawn(figure, f"{prefix}-bands", "bands", words=words)


def _bars(axes: Panel, banded: Sequence[Mapping[str, Any]]) -> None:
    top = max(0.5 * one["rate_hz"] for one in banded)
    lowest = min(0.01 * top, 0.5 * min(one["bandwidth_hz"] for one in banded))
    for row, one in enumerate(reversed(banded)):
        for end, colour in ((0.5 * one["rate_hz"], "grid"), (one["bandwidth_hz"], "measured")):
            axes.barh(row, end - lowest, left=lowest, height=0.6, color=COLOURS[colour])
    axes.set_xscale("log")
    axes.set_xlim(lowest, 1.1 * top)
    axes.set_yticks(range(len(banded)), [one["name"] for one in reversed(banded)])
    axes.xaxis.set_major_formatter("{x:g}")
