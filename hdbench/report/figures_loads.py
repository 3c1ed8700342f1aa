"""Figure of a diagnosed calibration: readings off the line before and after."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.records import FloatArray
from hdbench.report.canvas import COLOURS, draw_svg, label_axes, new_figure
from hdbench.report.elements import Picture

__all__ = ["load_pictures"]

Columns = Mapping[str, FloatArray]
# height of the figure, inch: two rows with room for four ticks each
_HEIGHT_IN = 4.4
_MARK = 3.2


def load_pictures(columns: Columns, prefix: str) -> tuple[Picture, ...]:
    """Draw the residual of calibration readings against torque, before and after."""
    name = f"{prefix}-loads"
    figure, rows = new_figure(2, _HEIGHT_IN, share_x=True)
    torque, used = columns["torque_nm"], columns["used"] > 0.0
    falling = columns["falling"] > 0.0
    size = {}
    for axes, when in zip(rows, ("before", "after"), strict=True):
        left = columns[f"residual_{when}_nm"]
        size[when] = float(np.sqrt(np.nanmean(left[used] ** 2))) if used.any() else 0.0
        for chosen, face in ((used & ~falling, COLOURS[when]), (used & falling, "none")):
            axes.plot(
                torque[chosen],
                left[chosen],
                linestyle="none",
                marker="o",
                markersize=_MARK,
                color=COLOURS[when],
                markerfacecolor=face,
            )
        if not used.all():
            axes.plot(
                torque[~used],
                left[~used],
                linestyle="none",
                marker="x",
                color=COLOURS["muted"],
            )
        axes.axhline(0.0, color=COLOURS["muted"], linewidth=0.8)
        label_axes(axes, None, "residual (N·m)", f"{when}: {size[when]:.3g} N·m rms")
    rows[-1].set_xlabel("applied torque (N·m)")
    rows[1].sharey(rows[0])
    caption = (
        f"Readings off the fitted line: {size['before']:.3g} N·m rms with one gain and one zero an "
        f"experiment, {size['after']:.3g} N·m rms with the causes that were found. Filled: "
        f"loading, open: unloading.{' Crosses: not used.' if not used.all() else ''}"
    )
    alt = (
        f"Residual of calibration readings against applied torque; its rms goes from "
        f"{size['before']:.3g} to {size['after']:.3g} newton metres."
    )
    return (Picture("Readings before and after", caption, alt, draw_svg(figure, name, alt)),)
