"""Figures as SVG that takes its colours from the page, so that light and dark both look right."""

from __future__ import annotations

import io
import re
from html import escape
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure

from hdbench.records import FloatArray
from hdbench.report.zoom import prepare_zoom

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "COLOURS",
    "WIDTH_IN",
    "draw_svg",
    "label_axes",
    "legend_above",
    "new_figure",
    "trend",
]

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
WIDTH_IN = 5.6
_STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "hdbench",
    "text.parse_math": False,
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9.5,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "legend.fontsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": COLOURS["muted"],
    "axes.labelcolor": COLOURS["ink"],
    "axes.titlecolor": COLOURS["ink"],
    "axes.facecolor": "none",
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.01,
    "grid.color": COLOURS["grid"],
    "grid.linewidth": 0.7,
    "xtick.color": COLOURS["muted"],
    "ytick.color": COLOURS["muted"],
    "xtick.labelcolor": COLOURS["ink"],
    "ytick.labelcolor": COLOURS["ink"],
    "text.color": COLOURS["ink"],
    "legend.frameon": False,
    "figure.facecolor": "none",
    "lines.linewidth": 1.1,
    "lines.solid_joinstyle": "round",
    "path.simplify": True,
    "path.simplify_threshold": 0.3,
}
_FONT = re.compile(r"font: ([\d.]+)px [^;\"]*")
_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_PATH = re.compile(r' d="([^"]*)"')
_HEAD = re.compile(r"<svg\b[^>]*?viewBox=\"([^\"]*)\"[^>]*>", re.DOTALL)
_METADATA = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)


def new_figure(
    rows: int, height_in: float, *, share_x: bool = False, ratios: tuple[float, ...] | None = None
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure with `rows` axes below each other."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
        grid = figure.subplots(
            rows, 1, sharex=share_x, squeeze=False, height_ratios=ratios or (1.0,) * rows
        )
        return figure, [grid[i, 0] for i in range(rows)]


def label_axes(axes: Axes, x: str | None, y: str, title: str | None = None) -> None:
    """Name the axes, with units; `x` None leaves the abscissa to the axes below."""
    if x is not None:
        axes.set_xlabel(x)
    axes.set_ylabel(y)
    if title is not None:
        axes.set_title(title, loc="left")


def legend_above(axes: Axes, columns: int = 3) -> None:
    """Put the legend above the axes, where it covers no data."""
    axes.legend(
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


def trend(
    axes: Axes,
    x: FloatArray,
    y: FloatArray,
    colour: str,
    *,
    width: float = 1.1,
    line: str = "-",
    label: str | None = None,
) -> None:
    """Draw a long curve; `draw_svg` thins it to as many points as a screen can show."""
    # drawn with few points, kept whole for the reader who zooms: see `prepare_zoom`
    axes.plot(x, y, color=COLOURS[colour], linewidth=width, linestyle=line, label=label)


def draw_svg(figure: Figure, name: str, alt: str) -> str:
    """Return the figure as inline SVG with the page's colours and an alternative text."""
    if not re.fullmatch(r"[A-Za-z0-9-]+", name):
        raise ValueError(f"name {name!r} must be letters, digits and hyphens")
    zoom = prepare_zoom(figure)
    buffer = io.StringIO()
    with mpl.rc_context(_STYLE):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = _METADATA.sub("", text[text.index("<svg") :])
    text = _PATH.sub(_shorter, text)
    text = _FONT.sub(r"font: \1px var(--sans)", text)
    for key, value in COLOURS.items():
        text = text.replace(value, f"var(--{key})")
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r"url\(#", f"url(#{name}-", text)
    text = re.sub(r'xlink:href="#', f'xlink:href="#{name}-', text)
    text = _HEAD.sub(lambda found: _head(found[1], alt), text, count=1).strip()
    return text.removesuffix("</svg>") + zoom.element(name) + "</svg>"


def _shorter(found: re.Match[str]) -> str:
    # a hundredth of a point is below what any screen or printer shows at this size
    return ' d="' + _NUMBER.sub(lambda n: f"{float(n[0]):.2f}", found[1]).replace("\n", "") + '"'


def _head(box: str, alt: str) -> str:
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'role="img" aria-label="{escape(alt)}" viewBox="{escape(box)}" '
        'preserveAspectRatio="xMidYMid meet">'
    )
