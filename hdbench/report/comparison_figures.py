"""Figures of a comparison: both results on one pair of axes, and what has moved."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hdbench.report.canvas import COLOURS, draw_svg, label_axes, legend_above, new_figure
from hdbench.report.elements import Picture
from hdbench.report.numbers import short, unit_words

__all__ = ["comparison_pictures", "first_up"]

# B dashed: two curves that agree are both seen
_LINES: dict[str, dict[str, Any]] = {"a": {"linestyle": "-"}, "b": {"linestyle": "--"}}


def first_up(text: str) -> str:
    """Return a text with a capital at its start and units as they are set on a page."""
    return unit_words(text[:1].upper() + text[1:])


def comparison_pictures(body: Mapping[str, Any]) -> tuple[Picture, ...]:
    """Draw both results on one pair of axes, and every score."""
    drawn = [_scores(body["quantities"])]
    if body["overlay"] is not None:
        drawn.insert(0, _overlay(body["kind"], body["overlay"]))
    return tuple(picture for picture in drawn if picture is not None)


def _overlay(kind: str, curves: Mapping[str, Any]) -> Picture:
    figure, (axes,) = new_figure(1, 3.0)
    style: dict[str, Any] = {}
    if kind == "calibration":
        style = {"linestyle": "none", "marker": "o", "markersize": 4.0}
    for side, colour in (("a", "before"), ("b", "filtered")):
        x, y = (np.array(curves[side][key]) for key in ("x", "y"))
        face = COLOURS["paper"] if side == "a" and style else COLOURS[colour]
        axes.plot(
            x,
            y,
            color=COLOURS[colour],
            label=side.upper(),
            markerfacecolor=face,
            markeredgecolor=COLOURS[colour],
            **(style or _LINES[side]),
        )
    words = [f"{curves[k]['label']} ({unit_words(curves[k]['unit'])})" for k in ("x", "y")]
    label_axes(axes, words[0], words[1])
    legend_above(axes)
    spans = [float(np.ptp(np.array(curves[s]["y"]))) for s in ("a", "b")]
    what = f"{words[1]} over {words[0]}"
    caption = (
        f"{first_up(what)} of both: from its lowest to its highest value A spans "
        f"{short(spans[0])} N·m and B {short(spans[1])} N·m."
    )
    alt = f"Two curves, A and B: {what}; A spans {spans[0]:.3g}, B {spans[1]:.3g} newton metres."
    return Picture("Both on one pair of axes", caption, alt, draw_svg(figure, "overlay", alt))


def _scores(rows: Sequence[Mapping[str, Any]]) -> Picture | None:
    told = [row for row in rows if row["score"] is not None]
    if not told:
        return None
    figure, (axes,) = new_figure(1, 0.9 + 0.34 * len(told))
    places = np.arange(len(told))[::-1]
    sizes = np.array([row["score"] for row in told])
    # on a logarithmic axis an identical pair has no place: it is drawn at the left edge
    least = 1e-2
    axes.axvline(1.0, color=COLOURS["expected"], linestyle="--")
    for place, size, row in zip(places, sizes, told, strict=True):
        filled = COLOURS["filtered"] if row["decides"] else COLOURS["paper"]
        axes.plot(max(size, least), place, "o", color=COLOURS["filtered"], markerfacecolor=filled)
    axes.set_xscale("log")
    axes.set_xlim(0.7 * least, max(3.0, 1.5 * float(sizes.max())))
    decades = 10.0 ** np.arange(-2, math.ceil(math.log10(max(3.0, float(sizes.max())))))
    axes.set_xticks(decades, [f"{decade:g}" for decade in decades])
    axes.set_xticks([], minor=True)
    axes.set_ylim(-0.6, len(told) - 0.4)
    axes.set_yticks(places, [row["label"] for row in told])
    label_axes(axes, "difference over its expanded uncertainty", "")
    caption = (
        "To the right of the dashed line a number has moved by more than its expanded uncertainty. "
        "Filled: the verdict rests on it. What stands at the left edge differs by 0.01 or less."
    )
    alt = "Scores: " + "; ".join(f"{row['label']} {row['score']:.2f}" for row in told)
    return Picture("What has moved", caption, alt, draw_svg(figure, "scores", alt))
