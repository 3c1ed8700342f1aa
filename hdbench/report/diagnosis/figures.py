"""Figures of a diagnosis: what the simulation misses, before and after it was extended."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.diagnosis.faults.scatter import mask_runs
from hdbench.records import FloatArray
from hdbench.report.canvas import COLOURS, Panel, min_max, new_figure
from hdbench.report.diagnosis.folder import Columns, read_columns
from hdbench.report.pagemodel import Picture

# samples in a close-up: enough to see a ripple, few enough to tell the dots
_CLOSE_SAMPLES = 160
# steps of a time that are longer than so many usual ones are a gap
_GAP_STEPS = 3.5
# of each spectrum: its file, its axis, the label and the name of the axis, its unit
_SPECTRA = (
    ("order", "motor_order", "motor order (cycles per motor turn)", "motor order", ""),
    ("frequency", "frequency_hz", "frequency (Hz)", "frequency", " Hz"),
    ("output-order", "output_order", "output order (cycles per output turn)", "output order", ""),
)
# of each map: its axis, the label of the abscissa, and what the ordinate is
_MAPS = {
    "velocity": ("motor_velocity_rad_s", "motor velocity (rad/s)", "mean"),
    "acceleration": ("motor_acceleration_rad_s2", "motor acceleration (rad/s²)", "mean"),
    "torque": ("applied_torque_nm", "load and expected torque (N·m)", "mean"),
    "output_angle": ("output_angle_rad", "output angle in its turn (rad)", "mean"),
    "motor_angle": ("motor_angle_rad", "motor angle in its turn (rad)", "mean"),
    "time": ("time_s", "time (s)", "mean"),
    "variance": ("absolute_velocity_rad_s", "absolute motor velocity (rad/s)", "rms"),
}
# height of one map, inch: enough for four ticks
_MAP_IN = 1.55


def folder_pictures(folder: Path, prefix: str) -> tuple[Picture, ...]:
    """Draw the tables that a diagnosis left in its folder; nothing without a residual."""
    columns = read_columns(folder / "residual.csv")
    if columns is None:
        return ()
    if "falling" in columns:
        return (_residual(columns, f"{prefix}-loads"),)
    drawn = [_comparison(columns, f"{prefix}-simulated"), _residual(columns, f"{prefix}-residual")]
    for stem, axis, label, words, unit in _SPECTRA:
        table = read_columns(folder / f"{stem.replace('-', '_')}_spectrum.csv")
        if table is not None:
            drawn.append(_spectrum(table, axis, label, words, unit, f"{prefix}-{stem}-spectrum"))
    maps = {name: table for name in _MAPS if (table := read_columns(folder / f"map_{name}.csv"))}
    if maps:
        drawn.append(_maps(maps, f"{prefix}-maps"))
    codes = read_columns(folder / "map_code.csv")
    if codes is not None:
        drawn.append(_codes(codes, f"{prefix}-codes"))
    return tuple(drawn)


def _rms(values: FloatArray, chosen: NDArray[np.bool_]) -> float:
    good = values[np.isfinite(values) & chosen]
    return float(np.sqrt(np.mean(good**2))) if len(good) else 0.0


def _comparison(columns: Columns, name: str) -> Picture:
    time, measured = columns["time_s"], columns["measured_nm"]
    figure, (whole, before, after) = new_figure(3, 5.6)
    for key, colour in (("measured", "measured"), ("simulated", "expected"), ("extended", "after")):
        whole.curve(time, columns[f"{key}_nm"], colour, linewidth=0.7, label=key)
    whole.label(None, "torque (N·m)")
    whole.legend_above()
    cut = _close_up(time)
    for axes, key, colour, words in (
        (before, "simulated_nm", "expected", "close-up: measured (dots) and simulated"),
        (after, "extended_nm", "after", "close-up: measured (dots) and extended simulation"),
    ):
        axes.curve(time[cut], measured[cut], "measured", "o", markersize=2.2)
        axes.curve(time[cut], columns[key][cut], colour)
        axes.label(None, "torque (N·m)", words)
    after.set_xlabel("time (s)")
    return Picture.drawn(figure, name, "simulated")


def _close_up(time: FloatArray) -> slice:
    """Return samples in the middle of the longest stretch without a gap, as between records."""
    steps = np.diff(time)
    ends = [0, *(np.flatnonzero(steps > _GAP_STEPS * np.median(steps)) + 1).tolist(), len(time)]
    first, last = max(itertools.pairwise(ends), key=lambda pair: pair[1] - pair[0])
    middle = (first + last) // 2
    return slice(middle, min(middle + _CLOSE_SAMPLES, last))


def _residual(columns: Columns, name: str) -> Picture:
    """Draw the residual before and after on one scale: over time, or of readings over torque."""
    loads = "falling" in columns
    figure, rows = new_figure(2, 4.4 if loads else 4.2, share_x=True)
    rows[1].sharey(rows[0])
    x = columns["torque_nm" if loads else "time_s"]
    used = columns["used"] > 0.0 if loads else ~(columns.get("masked", np.zeros(len(x))) > 0.0)
    rms = {}
    for axes, when in zip(rows, ("before", "after"), strict=True):
        left = columns[f"residual_{when}_nm"]
        rms[when] = f"{_rms(left, used):.3g}"
        if loads:
            _readings(axes, columns, used, when)
        else:
            axes.curve(x, left, when, linewidth=0.7)
            for first, last in mask_runs(~used):
                ends = x[first], x[last]
                axes.axvspan(*ends, color=COLOURS["expected"], alpha=0.2, linewidth=0)
        axes.label(None, "residual (N·m)", f"{when}: {rms[when]} N·m rms")
    rows[1].set_xlabel("applied torque (N·m)" if loads else "time (s)")
    note = ""
    if not used.all():
        hidden = f" Shaded: {np.count_nonzero(~used)} samples that were left out as faulty."
        note = " Crosses: not used." if loads else hidden
    return Picture.drawn(figure, name, "loads" if loads else "residual", note=note, **rms)


def _readings(axes: Panel, columns: Columns, used: NDArray[np.bool_], when: str) -> None:
    """Draw the residual of calibration readings over torque."""
    torque, left, falling = columns["torque_nm"], columns[f"residual_{when}_nm"], columns["falling"]
    for chosen, face in (
        (used & (falling <= 0.0), COLOURS[when]),
        (used & (falling > 0.0), "none"),
    ):
        axes.curve(torque[chosen], left[chosen], when, "o", markersize=3.2, markerfacecolor=face)
    if not used.all():
        axes.curve(torque[~used], left[~used], "muted", "x")
    axes.axhline(0.0, color=COLOURS["muted"], linewidth=0.8)


def _spectrum(table: Columns, axis: str, label: str, words: str, unit: str, name: str) -> Picture:
    figure, (axes,) = new_figure(1, 3.1)
    x, before, after = table[axis], table["before_nm"], table["after_nm"]
    decades = unit != ""  # frequencies span decades, and most of a residual is slow
    for line, when in ((before, "before"), (after, "after")):
        shown = (x, line) if decades else min_max(x, line)
        axes.curve(*shown, when, linewidth=1.0, label=when)
    axes.set_ylim(bottom=0.0)
    if decades:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
    axes.label(label, "amplitude (N·m)")
    axes.legend_above()
    at = int(np.nanargmax(before))
    peak, left, where = f"{before[at]:.3g}", f"{after[at]:.3g}", f"{x[at]:.4g}{unit}"
    rest = f"{left} N·m are left there." if after[at] > 0.0 else "nothing is left there."
    numbers = {"peak": peak, "left": left, "where": where, "rest": rest}
    return Picture.drawn(figure, name, "spectrum", axis=words, **numbers)


def _maps(tables: Mapping[str, Columns], name: str) -> Picture:
    """Draw the residual over every quantity of which the run holds a map."""
    figure, rows = new_figure(len(tables), _MAP_IN * len(tables) + 0.3)
    for axes, (key, table) in zip(rows, tables.items(), strict=True):
        axis, label, kind = _MAPS[key]
        for when in ("before", "after"):
            level, band = table[f"{when}_nm"], 2.0 * table[f"{when}_std_nm"]
            style: Any = {"color": COLOURS[when], "alpha": 0.2, "linewidth": 0}
            axes.fill_between(table[axis], level - band, level + band, **style)
            axes.curve(table[axis], level, when, label=when)
        if kind == "rms":
            axes.set_ylim(bottom=0.0)
        axes.label(label, f"{kind} (N·m)")
    rows[0].legend_above()
    reach = {key: float(np.nanmax(np.abs(table["before_nm"]))) for key, table in tables.items()}
    farthest = max(reach, key=lambda key: reach[key])
    axes_words = ", ".join(_MAPS[key][1] for key in tables)
    numbers = {"reach": reach[farthest], "farthest": _MAPS[farthest][1]}
    return Picture.drawn(figure, name, "maps", axes=axes_words, **numbers)


def _codes(table: Columns, name: str) -> Picture:
    figure, (axes,) = new_figure(1, 2.0)
    share = 100.0 * table["share"]
    axes.bar(table["code_modulo_32"], share, width=0.8, color=COLOURS["measured"])
    axes.label("code of the converter modulo 32", "share (%)")
    never = int(np.count_nonzero(table["samples"] == 0.0))
    return Picture.drawn(figure, name, "codes", never=never)
