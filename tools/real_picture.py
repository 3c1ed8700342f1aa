"""The picture of a log in the gallery: measured against simulated and extended torque."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

__all__ = ["draw"]

# grey, blue and orange that can be told apart on white and on black
_INK, _BLUE, _ORANGE = "#808080", "#3b8eea", "#e8801a"
_CLOSE_SAMPLES = 300
_COLOURS = 64


def draw(body: Mapping[str, Any], folder: Path, docs: Path, name: str) -> str | None:
    """Write the picture below the page; return its path from there, None without a diagnosis."""
    found = sorted(folder.glob("runs/*/residual.csv"))
    if "causes" not in body or not found:
        return None
    with found[-1].open(newline="") as file:
        rows = list(csv.DictReader(file))
    table = {key: np.array([float(row[key] or "nan") for row in rows]) for key in rows[0]}
    time, measured = table["time_s"], table["measured_nm"]
    # through the low-pass that the record went through, where there is one
    simulated, extended = (measured - table[f"residual_{when}_nm"] for when in ("before", "after"))
    figure = Figure(figsize=(7.2, 4.6), layout="constrained")
    whole, close = figure.subplots(2, 1)
    middle = len(time) // 2
    cut = slice(middle, middle + _CLOSE_SAMPLES)
    whole.plot(time, measured, color=_INK, linewidth=0.7, label="measured")
    close.plot(time[cut], measured[cut], ".", color=_INK, markersize=3)
    for axes, part in ((whole, slice(None)), (close, cut)):
        for torque, colour, label in (
            (simulated, _BLUE, "simulated"),
            (extended, _ORANGE, "extended simulation"),
        ):
            axes.plot(time[part], torque[part], color=colour, linewidth=0.9, label=label)
        axes.set_ylabel("torque (N·m)", color=_INK)
        axes.tick_params(colors=_INK)
        axes.grid(color=_INK, alpha=0.25, linewidth=0.5)
        for spine in axes.spines.values():
            spine.set_color(_INK)
    whole.legend(
        loc="lower left", bbox_to_anchor=(0, 1), ncols=3, frameon=False, labelcolor=_INK, fontsize=9
    )
    close.set_xlabel("time (s), close-up of the middle", color=_INK)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=125, transparent=True)
    picture = docs / "images" / "real" / f"{name}.png"
    picture.parent.mkdir(parents=True, exist_ok=True)
    # few colours take a quarter of the bytes and look the same
    Image.open(buffer).quantize(_COLOURS, method=Image.Quantize.FASTOCTREE).save(
        picture, optimize=True
    )
    return f"images/real/{name}.png"
