"""Figures of a diagnosis: the residual over speed, acceleration, torque and angles."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hdbench.records import FloatArray
from hdbench.report.canvas import COLOURS, draw_svg, label_axes, legend_above, new_figure
from hdbench.report.columns import read_columns
from hdbench.report.elements import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["map_pictures"]

Columns = Mapping[str, FloatArray]
# file of each map: its axis, the label of the abscissa, and what the ordinate is
_MAPS = {
    "map_velocity.csv": ("motor_velocity_rad_s", "motor velocity (rad/s)", "mean"),
    "map_acceleration.csv": (
        "motor_acceleration_rad_s2",
        "motor acceleration (rad/s²)",
        "mean",
    ),
    "map_torque.csv": ("applied_torque_nm", "load and expected torque (N·m)", "mean"),
    "map_output_angle.csv": ("output_angle_rad", "output angle in its turn (rad)", "mean"),
    "map_motor_angle.csv": ("motor_angle_rad", "motor angle in its turn (rad)", "mean"),
    "map_time.csv": ("time_s", "time (s)", "mean"),
    "map_variance.csv": ("absolute_velocity_rad_s", "absolute motor velocity (rad/s)", "rms"),
}
# height of one map, inch: enough for four ticks
_ROW_IN = 1.55
# a mean is drawn with twice its standard deviation on both sides
_BAND = 2.0


def map_pictures(folder: Path, prefix: str) -> tuple[Picture, ...]:
    """Draw the residual over every quantity of which the run holds a map."""
    found = {name: table for name in _MAPS if (table := read_columns(folder / name)) is not None}
    drawn = [_maps(found, f"{prefix}-maps")] if found else []
    codes = read_columns(folder / "map_code.csv")
    if codes is not None:
        drawn.append(_codes(codes, f"{prefix}-codes"))
    return tuple(drawn)


def _maps(tables: Mapping[str, Columns], name: str) -> Picture:
    figure, rows = new_figure(len(tables), _ROW_IN * len(tables) + 0.3)
    for axes, (file, table) in zip(rows, tables.items(), strict=True):
        key, label, kind = _MAPS[file]
        for when in ("before", "after"):
            _level(axes, table[key], table[f"{when}_nm"], table[f"{when}_std_nm"], when)
        if kind == "rms":
            axes.set_ylim(bottom=0.0)
        label_axes(axes, label, f"{kind} (N·m)")
    legend_above(rows[0])
    caption = (
        "Residual in bins of what it could depend on, with twice its standard deviation as a band: "
        "before, a curve that leaves zero says where the simulation is wrong; after the extension "
        "it should lie on zero. The last one, over absolute speed, is the root mean square: it "
        "shows noise that grows with speed."
    )
    steepest = max(tables, key=lambda file: _reach(tables[file]))
    alt = (
        "Mean residual before and after the extension over "
        + ", ".join(_MAPS[file][1] for file in tables)
        + f"; before, it reaches {_reach(tables[steepest]):.3g} newton metres over "
        + f"{_MAPS[steepest][1]}."
    )
    return Picture("Where the residual sits", caption, alt, draw_svg(figure, name, alt))


def _reach(table: Columns) -> float:
    return float(np.nanmax(np.abs(table["before_nm"])))


def _level(axes: Axes, x: FloatArray, y: FloatArray, std: FloatArray, when: str) -> None:
    axes.fill_between(
        x,
        y - _BAND * std,
        y + _BAND * std,
        color=COLOURS[when],
        alpha=0.2,
        linewidth=0,
    )
    axes.plot(x, y, color=COLOURS[when], linewidth=1.1, label=when)


def _codes(table: Columns, name: str) -> Picture:
    figure, (axes,) = new_figure(1, 2.0)
    share = 100.0 * table["share"]
    axes.bar(table["code_modulo_32"], share, width=0.8, color=COLOURS["measured"])
    label_axes(axes, "code of the converter modulo 32", "share (%)")
    never = int(np.count_nonzero(table["samples"] == 0.0))
    caption = (
        "How often each of the converter's codes came, modulo 32. All alike is as it should be; a "
        f"comb means a stuck bit or a coarser step. {never} of 32 never came."
    )
    alt = f"Histogram of converter codes modulo 32; {never} of 32 never came."
    return Picture("Codes of the converter", caption, alt, draw_svg(figure, name, alt))
