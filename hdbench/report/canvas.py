"""Figures as SVG that takes its colours from the page, so that light and dark both look right."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Sequence
from html import escape
from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter

from hdbench.records import FloatArray
from hdbench.report.texts import TEMPLATES

# placeholders that the page's style sheet replaces by its own colours, light or dark
COLOURS = {
    "ink": "#0101f1",
    "muted": "#0202f2",
    "grid": "#0303f3",
    "measured": "#0404f4",
    "filtered": "#0505f5",
    "expected": "#0606f6",
    "lowpass": "#0707f7",
    "before": "#0808f8",
    "after": "#0909f9",
    "paper": "#0a0afa",
}
# at this width text of 9.5 pt is readable at 340 px and not clumsy at 760 px
_WIDTH_IN = 5.6
_LEAST_SCORE = 1e-2
# of each of so many stretches of a curve the smallest and the largest value are drawn
_STRETCHES = 4000
_STYLE: Any = mpl.rc_params_from_file(TEMPLATES / "figure.mplstyle", use_default_template=False)
_FONT = re.compile(r"font: ([\d.]+)px [^;\"]*")
_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_PATH = re.compile(r' d="([^"]*)"')
_HEAD = re.compile(r"<svg\b[^>]*?viewBox=\"([^\"]*)\"[^>]*>", re.DOTALL)
_METADATA = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)


class Panel(Axes):
    """Axes that draw in the colours of the page."""

    def curve(self, x: Any, y: Any, colour: str, *args: str, **style: Any) -> None:
        """Draw a curve; `draw_svg` thins a long one."""
        self.plot(x, y, *args, color=COLOURS[colour], **style)

    def points(self, x: Any, y: Any, colour: str, *, filled: bool, **style: Any) -> None:
        """Draw points without a line; what is not filled shows the page."""
        face, edge = COLOURS[colour if filled else "paper"], COLOURS[colour]
        style = {"linestyle": "none", "marker": "o", "zorder": 3, "color": edge, **style}
        self.plot(x, y, markerfacecolor=face, markeredgecolor=edge, **style)

    def label(self, x: str | None, y: str, title: str | None = None) -> None:
        """Name the axes, with units; `x` None leaves the abscissa to the axes below."""
        if x is not None:
            self.set_xlabel(x)
        self.set_ylabel(y)
        if title is not None:
            self.set_title(title, loc="left")

    def legend_above(self, columns: int = 3) -> None:
        """Put the legend above the axes, where it covers no data."""
        self.legend(
            loc="lower left",
            bbox_to_anchor=(-0.01, 0.99),
            ncols=columns,
            borderaxespad=0.1,
            handlelength=1.8,
            columnspacing=1.2,
            fontsize=9.0,
            frameon=False,
            labelcolor=COLOURS["ink"],
        )


def new_figure(
    rows: int, height_in: float, *, share_x: bool = False, ratios: tuple[float, ...] | None = None
) -> tuple[Figure, list[Panel]]:
    """Return an empty figure with `rows` panels below each other."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(_WIDTH_IN, height_in), layout="constrained")
        grid = figure.subplots(
            rows,
            1,
            sharex=share_x,
            squeeze=False,
            height_ratios=ratios or (1.0,) * rows,
            subplot_kw={"axes_class": Panel},
        )
        return figure, [grid[i, 0] for i in range(rows)]


def score_chart(rows: Sequence[tuple[str, float, bool]], label: str) -> Figure:
    """Draw how far each named number moved, with a line at 1; filled or open dots."""
    figure, (axes,) = new_figure(1, 0.9 + 0.32 * len(rows))
    axes.axvline(1.0, color=COLOURS["expected"], linestyle="--")
    # on a logarithmic axis what did not move has no place: it is drawn at the left edge
    for place, (_, size, filled) in enumerate(reversed(rows)):
        axes.points(max(size, _LEAST_SCORE), place, "filtered", filled=filled)
    top = max(3.0, *(size for _, size, _ in rows))
    axes.set_xscale("log")
    axes.set_xlim(0.7 * _LEAST_SCORE, 1.5 * top)
    decades = 10.0 ** np.arange(-2, math.ceil(math.log10(1.5 * top)))
    axes.set_xticks(decades, [f"{decade:g}" for decade in decades])
    axes.set_xticks([], minor=True)
    axes.set_ylim(-0.6, len(rows) - 0.4)
    axes.set_yticks(range(len(rows)), [name for name, _, _ in reversed(rows)])
    axes.label(label, "")
    return figure


def min_max(x: FloatArray, y: FloatArray, stretches: int = 600) -> tuple[FloatArray, FloatArray]:
    """Keep the smallest and the largest value of each stretch of a curve.

    Examples
    --------
    >>> x = np.arange(8.0)
    >>> min_max(x, np.array([0.0, 3.0, 1.0, 1.0, 0.0, 0.0, -5.0, 0.0]), 2)
    (array([0., 1., 4., 6.]), array([ 0.,  3.,  0., -5.]))
    """
    if len(y) <= 2 * stretches:
        return x, y
    kept: list[tuple[int, bool]] = []
    for start, stop in pairwise(np.linspace(0, len(y), stretches + 1).astype(np.intp).tolist()):
        present = np.flatnonzero(np.isfinite(y[start:stop])) + start
        if len(present):
            ends = {int(present[pick(y[present])]) for pick in (np.argmin, np.argmax)}
            kept += [(place, True) for place in sorted(ends)]
        if len(present) < stop - start:
            # lost samples break the line
            kept.append((stop - 1, False))
    places = [place for place, _ in kept]
    return x[places], np.where([good for _, good in kept], y[places], np.nan)


def draw_svg(figure: Figure, name: str, alt: str) -> str:
    """Return the figure as inline SVG with the page's colours and an alternative text."""
    if not re.fullmatch(r"[A-Za-z0-9-]+", name):
        raise ValueError(f"name {name!r} must be letters, digits and hyphens")
    labels = [_thinned_curves(axes, place) for place, axes in enumerate(figure.axes)]
    buffer = io.StringIO()
    with mpl.rc_context(_STYLE):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = _METADATA.sub("", text[text.index("<svg") :])
    text = _PATH.sub(_shorter, text)
    text = _FONT.sub(r"font: \1px var(--sans)", text)
    for key, value in COLOURS.items():
        text = text.replace(value, f"var(--{key})")
    text = re.sub(r'(\bid="|url\(#|xlink:href="#)', rf"\g<1>{name}-", text)
    text = _HEAD.sub(lambda found: _head(found[1], alt), text, count=1).strip()
    return text.removesuffix("</svg>") + _scales(figure, labels) + "</svg>"


def _shorter(found: re.Match[str]) -> str:
    # a thousandth of a point is below what a reader who zooms tells apart
    short = _NUMBER.sub(lambda n: f"{float(n[0]):.3f}", found[1])
    return ' d="' + short.replace("\n", "").strip() + '"'


def _head(box: str, alt: str) -> str:
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'role="img" aria-label="{escape(alt)}" viewBox="{escape(box)}" '
        'preserveAspectRatio="xMidYMid meet">'
    )


def _thinned_curves(axes: Axes, place: int) -> list[str]:
    """Thin the curves over data, number them for the page's script, and return their labels."""
    curves = [line for line in axes.lines if line.get_transform() == axes.transData]
    for number, line in enumerate(curves):
        x, y = (np.asarray(v, dtype=np.float64) for v in (line.get_xdata(), line.get_ydata()))
        if np.all(np.diff(x) >= 0.0):
            line.set_data(*min_max(x, y, _STRETCHES))
        line.set_gid(f"curve-{place}-{number}")
    return [str(line.get_label()) for line in curves]


def _scales(figure: Figure, labels: list[list[str]]) -> str:
    """Return what the page's script needs to zoom: frames, scales and labels."""
    width, height = (72.0 * float(size) for size in figure.get_size_inches())
    specs = []
    for place, (axes, names) in enumerate(zip(figure.axes, labels, strict=True)):
        formats = [axis.get_major_formatter() for axis in (axes.xaxis, axes.yaxis)]
        # the script writes numbers: no dates, no names
        if not names or any(isinstance(f, ConciseDateFormatter | FixedFormatter) for f in formats):
            continue
        box = axes.get_position()
        joined = [
            at
            for at, other in enumerate(figure.axes)
            if axes.get_shared_x_axes().joined(axes, other)
        ] or [place]
        log = axes.get_xscale() == "log", axes.get_yscale() == "log"
        limits = axes.get_xlim(), axes.get_ylim()
        x, y = (
            [math.log10(v) if scale else float(v) for v in ends]
            for scale, ends in zip(log, limits, strict=True)
        )
        frame = (box.x0 * width, (1.0 - box.y1) * height, box.width * width, box.height * height)
        specs.append(
            {
                "at": place,
                "box": [round(v, 3) for v in frame],
                "x": x,
                "y": y,
                "logx": log[0],
                "logy": log[1],
                "xlabel": figure.axes[joined[-1]].get_xlabel(),
                "ylabel": axes.get_ylabel().replace("\n", " "),
                "group": joined[0],
                "labels": ["" if name.startswith("_") else name for name in names],
            }
        )
    if not specs:
        return ""
    text = json.dumps(specs, allow_nan=False, separators=(",", ":"))
    return f'<metadata class="axes">{escape(text, quote=False)}</metadata>'
