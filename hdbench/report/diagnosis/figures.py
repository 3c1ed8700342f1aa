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
from hdbench.report.canvas import COLOURS, min_max, new_figure
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
        return (_loads(columns, f"{prefix}-loads"),)
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


def _loads(columns: Columns, name: str) -> Picture:
    """Draw the residual of calibration readings against torque, before and after."""
    figure, rows = new_figure(2, 4.4, share_x=True)
    rows[1].sharey(rows[0])
    torque, used, falling = columns["torque_nm"], columns["used"] > 0.0, columns["falling"] > 0.0
    size = []
    for axes, when in zip(rows, ("before", "after"), strict=True):
        left = columns[f"residual_{when}_nm"]
        size.append(f"{_rms(left, used):.3g}")
        for chosen, face in ((used & ~falling, COLOURS[when]), (used & falling, "none")):
            style = {"markersize": 3.2, "markerfacecolor": face}
            axes.curve(torque[chosen], left[chosen], when, "o", **style)
        if not used.all():
            axes.curve(torque[~used], left[~used], "muted", "x")
        axes.axhline(0.0, color=COLOURS["muted"], linewidth=0.8)
        axes.label(None, "residual (N·m)", f"{when}: {size[-1]} N·m rms")
    rows[1].set_xlabel("applied torque (N·m)")
    caption = (
        f"Readings off the fitted line: {size[0]} N·m rms with one gain and one zero an "
        f"experiment, {size[1]} N·m rms with the causes that were found. Filled: "
        f"loading, open: unloading.{' Crosses: not used.' if not used.all() else ''}"
    )
    alt = (
        f"Residual of calibration readings against applied torque; its rms goes from "
        f"{size[0]} to {size[1]} newton metres."
    )
    return Picture.drawn(figure, name, "Readings before and after", caption, alt)


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
    caption = (
        "Measured torque against the simulation of the same motion: as the model was handed in "
        "(middle) and with the causes that were found (below). Where the line runs through the "
        "dots, the simulation explains the measurement."
    )
    alt = "Measured torque over time with the simulated torque, before and after the extension."
    return Picture.drawn(figure, name, "Measured against simulated", caption, alt)


def _close_up(time: FloatArray) -> slice:
    """Return samples in the middle of the longest stretch without a gap, as between records."""
    steps = np.diff(time)
    ends = [0, *(np.flatnonzero(steps > _GAP_STEPS * np.median(steps)) + 1).tolist(), len(time)]
    first, last = max(itertools.pairwise(ends), key=lambda pair: pair[1] - pair[0])
    middle = (first + last) // 2
    return slice(middle, min(middle + _CLOSE_SAMPLES, last))


def _residual(columns: Columns, name: str) -> Picture:
    time = columns["time_s"]
    masked = columns.get("masked", np.zeros(len(time))) > 0.0
    figure, rows = new_figure(2, 4.2, share_x=True)
    rows[1].sharey(rows[0])
    rms = []
    for axes, when in zip(rows, ("before", "after"), strict=True):
        left = columns[f"residual_{when}_nm"]
        rms.append(f"{_rms(left, ~masked):.3g}")
        axes.curve(time, left, when, linewidth=0.7)
        axes.label(None, "residual (N·m)", f"{when}: {rms[-1]} N·m rms")
        for first, last in mask_runs(masked):
            ends = time[first], time[last]
            axes.axvspan(*ends, color=COLOURS["expected"], alpha=0.2, linewidth=0)
    rows[1].set_xlabel("time (s)")
    hidden = int(np.count_nonzero(masked))
    note = f" Shaded: {hidden} samples that were left out as faulty." if hidden else ""
    caption = (
        f"What the simulation misses, on one scale: {rms[0]} N·m rms before, {rms[1]} "
        f"N·m rms after it was extended by the causes found.{note}"
    )
    alt = (
        f"Residual torque over time before and after the model was extended; its rms falls from "
        f"{rms[0]} to {rms[1]} newton metres."
    )
    return Picture.drawn(figure, name, "Residual before and after", caption, alt)


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
    caption = (
        f"Amplitude of the residual over {words}. Before: the highest peak is {peak} N·m at "
        f"{where}; after the extension {rest}"
    )
    alt = (
        f"Residual amplitude over {words}; the peak at {where} falls from {peak} to {left} "
        "newton metres."
    )
    return Picture.drawn(figure, name, f"Residual over {words}", caption, alt)


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
    caption = (
        "Residual in bins of what it could depend on, with twice its standard deviation as a band: "
        "before, a curve that leaves zero says where the simulation is wrong; after the extension "
        "it should lie on zero. The last one, over absolute speed, is the root mean square: it "
        "shows noise that grows with speed."
    )
    reach = {key: float(np.nanmax(np.abs(table["before_nm"]))) for key, table in tables.items()}
    farthest = max(reach, key=lambda key: reach[key])
    alt = (
        "Mean residual before and after the extension over "
        + ", ".join(_MAPS[key][1] for key in tables)
        + f"; before, it reaches {reach[farthest]:.3g} newton metres over {_MAPS[farthest][1]}."
    )
    return Picture.drawn(figure, name, "Where the residual sits", caption, alt)


def _codes(table: Columns, name: str) -> Picture:
    figure, (axes,) = new_figure(1, 2.0)
    share = 100.0 * table["share"]
    axes.bar(table["code_modulo_32"], share, width=0.8, color=COLOURS["measured"])
    axes.label("code of the converter modulo 32", "share (%)")
    never = int(np.count_nonzero(table["samples"] == 0.0))
    caption = (
        "How often each of the converter's codes came, modulo 32. A sound converter gives equal "
        f"shares; a comb means a stuck bit or a coarser step. {never} of 32 never came."
    )
    alt = f"Histogram of converter codes modulo 32; {never} of 32 never came."
    return Picture.drawn(figure, name, "Codes of the converter", caption, alt)
