"""What the page's script needs to redraw a figure: axes, scales, and every sample of its curves."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.dates import ConciseDateFormatter

from hdbench.records import FloatArray
from hdbench.report.decimate import min_max

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

__all__ = ["Zoom", "prepare_zoom"]

# a minute at 1 kHz goes whole; beyond it each stretch keeps its smallest and largest value
_MOST_POINTS = 65_536
# steps of time that differ by less than a millionth are even for a picture
_EVEN = 1e-6
_POINTS_PER_INCH = 72.0
_PLACES = 3


@dataclass(frozen=True, slots=True)
class Zoom:
    """A figure that is ready to be drawn and to be zoomed.

    Parameters
    ----------
    figure : Figure
        Its long curves are thinned to what a screen shows.
    curves : tuple of dict
        Per axes: lines with all their samples, and what moves with them.
    """

    figure: Figure
    curves: tuple[dict[str, Any], ...]

    def element(self, name: str) -> str:
        """Return the description as an SVG element; to be called after the figure was drawn."""
        height = float(self.figure.get_figheight()) * _POINTS_PER_INCH
        width = float(self.figure.get_figwidth()) * _POINTS_PER_INCH
        axes = []
        for place, (one, curves) in enumerate(zip(self.figure.axes, self.curves, strict=True)):
            if not curves["lines"] or one.get_xscale() not in ("linear", "log"):
                continue
            if isinstance(one.xaxis.get_major_formatter(), ConciseDateFormatter):
                continue  # the script writes numbers, not dates
            box = one.get_position()
            axes.append(
                {
                    **curves,
                    "at": place,
                    "box": [
                        round(box.x0 * width, _PLACES),
                        round((1.0 - box.y1) * height, _PLACES),
                        round(box.width * width, _PLACES),
                        round(box.height * height, _PLACES),
                    ],
                    "x": [float(v) for v in one.get_xlim()],
                    "y": [float(v) for v in one.get_ylim()],
                    "logx": one.get_xscale() == "log",
                    "logy": one.get_yscale() == "log",
                    "xlabel": _abscissa(self.figure.axes, place),
                    "ylabel": one.get_ylabel(),
                    "group": _group(self.figure.axes, place),
                }
            )
        if not axes:
            return ""
        text = json.dumps({"name": name, "axes": axes}, allow_nan=False, separators=(",", ":"))
        return f'<metadata class="curves">{escape(text, quote=False)}</metadata>'


def prepare_zoom(figure: Figure) -> Zoom:
    """Name the parts of a figure, keep the samples of its curves, and thin what is drawn."""
    curves = []
    for place, axes in enumerate(figure.axes):
        lines: list[dict[str, Any]] = []
        moved: list[str] = []
        for number, artist in enumerate([*axes.lines, *axes.collections, *axes.patches]):
            gid = f"part-{place}-{number}"
            artist.set_gid(gid)
            if artist in axes.lines and artist.get_transform() == axes.transData:
                lines.append(_line(axes.lines[number], gid))
            else:
                moved.append(gid)
        curves.append({"lines": lines, "moved": moved, "texts": _texts(axes, place)})
    return Zoom(figure, tuple(curves))


def _texts(axes: Axes, place: int) -> list[dict[str, Any]]:
    found = []
    for number, text in enumerate(axes.texts):
        at = getattr(text, "xy", None) or text.get_position()
        data = getattr(text, "xycoords", "data") == "data" and (
            hasattr(text, "xy") or text.get_transform() == axes.transData
        )
        if data and np.isfinite(at).all():
            gid = f"text-{place}-{number}"
            text.set_gid(gid)
            found.append({"id": gid, "x": float(at[0]), "y": float(at[1])})
    return found


def _line(line: Line2D, gid: str) -> dict[str, Any]:
    x = np.asarray(line.get_xdata(), dtype=np.float64)
    y = np.asarray(line.get_ydata(), dtype=np.float64)
    kept_x, kept_y = (x, y) if len(y) <= _MOST_POINTS else min_max(x, y, _MOST_POINTS // 3)
    rising = bool(len(x) > 1 and np.all(np.diff(x) >= 0.0))
    if rising:
        line.set_data(*min_max(x, y))
    label = str(line.get_label())
    marker = line.get_marker() not in (None, "None", "", " ")
    return {
        "id": gid,
        "label": "" if label.startswith("_") else label,
        "rising": rising,
        "marker": marker,
        "open": marker and str(line.get_markerfacecolor()) in ("none", "None"),
        "line": line.get_linestyle() not in ("None", "none", "", " "),
        "thinned": len(kept_y) < len(y),
        "xs": _numbers(kept_x, exact=True),
        "ys": _numbers(kept_y, exact=False),
    }


def _numbers(values: FloatArray, *, exact: bool) -> dict[str, Any]:
    """Return an array as JSON: start and step where it is even, else its bytes in base 64."""
    if exact and len(values) > 2:
        steps = np.diff(values)
        step = (values[-1] - values[0]) / (len(values) - 1)
        if step > 0.0 and np.all(np.abs(steps - step) <= _EVEN * step):
            return {"start": float(values[0]), "step": float(step), "n": len(values)}
    kind = "<f8" if exact else "<f4"
    raw = np.ascontiguousarray(values, dtype=kind).tobytes()
    return {"bytes": 8 if exact else 4, "data": base64.b64encode(raw).decode()}


def _abscissa(axes: list[Axes], place: int) -> str:
    """Return the name of the abscissa, which the lowest of several axes bears for all."""
    shared = axes[place].get_shared_x_axes()
    names = [one.get_xlabel() for one in axes if shared.joined(axes[place], one)]
    return str(axes[place].get_xlabel() or next((name for name in names if name), ""))


def _group(axes: list[Axes], place: int) -> int:
    """Return the first axes that share their abscissa with those at `place`."""
    shared = axes[place].get_shared_x_axes()
    joined = (i for i, other in enumerate(axes) if shared.joined(axes[place], other))
    return next(joined, place)
