"""The tables of `hdbench gauge errors`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["show_errors"]

_SIZES = {
    "radial": ("radial_mm", "mm"),
    "circumferential": ("circumferential_deg", "deg"),
    "angular": ("angular_deg", "deg"),
    "off-centre": ("off_centre_mm", "mm"),
}


def show_errors(console: Console, body: dict[str, Any]) -> None:
    """Draw the tables of `hdbench gauge errors`."""
    from rich.text import Text

    for line in _why(body):
        console.print(Text(line), soft_wrap=True)
    _show_one_off(console, body)
    _show_scatter(console, body)
    console.print(Text(f"\n{body['sentence']}"), soft_wrap=True)
    if body["flexspline"] == "turning":
        text = "The flexspline turns: an order counts wave-generator turns against it, "
        text += "(1 + 1/N) of them in a motor turn."
        console.print(Text(text), soft_wrap=True)
    for name, path in body.get("files", {}).items():
        console.print(Text(f"{name}  {path}"), soft_wrap=True)


def _why(body: dict[str, Any]) -> list[str]:
    angles = [r["angle_deg"] for r in body["layout"]["rosettes"]]
    lines = [f"{body['layout']['words']}, on radius {body['layout']['radius_mm']:g} mm"]
    for wave in body["uncancelled_nm"]:
        phases = ", ".join(f"{math.fmod(wave['order'] * angle, 360.0):g}" for angle in angles)
        left = wave["left_by_layout"]
        # 1e-9: rounding of the phasors' sum
        end = "they cancel" if left < 1e-9 else f"{100 * left:.0f} % of it stays"
        lines.append(
            f"  order {wave['order']:g}: {wave['amplitude_nm']:.3g} N m uncancelled; the rosettes "
            f"see it at {phases} degrees: {end}"
        )
    return [*lines, _spread_hint(body)]


def _spread_hint(body: dict[str, Any]) -> str:
    if body["layout"]["name"] == "spread":
        return "  order 2 turns by 90 degrees from one rosette to the next, order 4 by 180"
    text = (
        "  order 2 turns by 180 degrees from one rosette to the next, order 4 by 360: only rosettes"
    )
    return f"{text} 45 degrees apart cancel both (--layout spread)"


_HEAD = ("gain", "zero", "locked zero", "ripple 2x", "ripple 4x")
_NAMES = ("gain_change", "zero_nm", "locked_zero_nm", "ripple_2_nm", "ripple_4_nm")


def _cells(values: list[float]) -> list[str]:
    gain, *torques = values
    return [f"{100 * gain:.3f} %", *(f"{t:.4f}" if abs(t) >= 5e-5 else "0" for t in torques)]


def _show_one_off(console: Console, body: dict[str, Any]) -> None:
    from rich.table import Table

    table = Table("one rosette off by", "which", *_HEAD, "closed 2x", box=None, pad_edge=False)
    nothing = _cells([body["in_place"][name] for name in _NAMES])
    table.add_row("nothing", "all", *nothing, "")
    merged: dict[tuple[str, ...], list[str]] = {}
    for row in body["one_off"]:
        name, unit = _SIZES[row["kind"]]
        closed = row["closed_form_2_nm"]
        cells = _cells([row["effects"][name] for name in _NAMES])
        key = (
            f"{body['tolerance'][name]:g} {unit} {row['kind']}",
            *cells,
            "" if closed is None else f"{closed:.4f}",
        )
        merged.setdefault(key, []).append(str(row["rosette"] or "film"))
    for key, numbers in merged.items():
        table.add_row(key[0], ", ".join(numbers), *key[1:])
    console.print()
    console.print(table)


def _show_scatter(console: Console, body: dict[str, Any]) -> None:
    from rich.table import Table

    table = Table("all off by chance", "of 100", *_HEAD, box=None, pad_edge=False)
    for row in body["scatter"]:
        for index in (0, 2):
            found = [row["effects"][name][index] for name in _NAMES]
            cells = _cells([q["value"] for q in found])
            share = f"{100 * found[0]['share']:.0f} below"
            table.add_row(row["kind"] if index == 0 else "", share, *cells)
    console.print()
    console.print(table)
    text = f"N m; {body['draws']} draws, {body['tolerance']['distribution']}, seed {body['seed']}"
    console.print(text, style="dim")
