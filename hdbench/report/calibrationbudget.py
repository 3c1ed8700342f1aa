"""Tables of the calibration record: uncertainty budget, corrections of the applied torque."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdbench.report.calibrationwords import declared, fixed, percent, ppm
from hdbench.report.elements import Table
from hdbench.report.numbers import DASH, short

__all__ = ["budget_table", "corrections_table"]

Result = Mapping[str, Any]


def budget_table(result: Result) -> Table:
    """Return the uncertainty budget of the gain."""
    rows = tuple(
        (
            row["name"],
            declared(None if row["half_width"] is None else float(row["half_width"])),
            row["unit"],
            row["distribution"] if row["declared"] else DASH,
            fixed(row["divisor"], 3) if row["declared"] else DASH,
            short(row["sensitivity"]) if row["declared"] else DASH,
            ppm(row["relative_std"]) if row["declared"] else DASH,
            "∞" if row["dof"] is None else f"{row['dof']:.3g}",
            percent(row["share"], 1) if row["declared"] else DASH,
            row["origin"],
        )
        for row in result["budget"]
    )
    head = (
        "source",
        "half width or u",
        "unit",
        "distribution",
        "divisor",
        "sensitivity",
        "u of the gain (ppm)",
        "dof",
        "share (%)",
        "certificate or origin",
    )
    note = (
        "Sources of the applied torque scale every reading alike: they are added after averaging "
        "and are not divided by the number of readings. What is not declared counts as nothing."
    )
    return Table("Uncertainty budget of the gain", head, rows, note)


def corrections_table(result: Result) -> Table:
    """Return every correction of the applied torque; without rows where none was made of a mass."""
    torque = result["torque"]
    rows = tuple(
        (
            c["name"],
            fixed(1e6 * c["relative"], 1) if c["made"] else "not made",
            percent(c["uncertainty_share"], 1),
            c["detail"],
        )
        for c in torque["corrections"]
    )
    force = result.get("side_force")
    if force is not None:
        half = force["half_direction_difference"]
        size = "not known" if half is None else f"at most {fixed(1e6 * half, 0)}"
        bending = force["bending_nm"]
        moment = "" if bending is None else f", bending moment {bending:.3g} N·m"
        with_ = f"{force['force_n']:.4g} N{moment}; {force['reason']}"
        rows = (*rows, ("side force", size, DASH, with_))
    note = ""
    if torque["largest_nm"] is not None:
        note = (
            f"At the largest load: {torque['largest_nominal_nm']:.5f} N·m by mass, local gravity "
            f"and length; {torque['largest_nm']:.5f} N·m corrected, relative standard uncertainty "
            f"{1e6 * torque['relative_std']:.0f} ppm."
        )
    head = ("correction", "size (ppm)", "share of the torque's variance (%)", "with")
    return Table("Applied torque, correction by correction", head, rows, note)
