"""The page of a comparison of two results: verdict, overlay, numbers, what else differs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hdbench.report.comparison_figures import comparison_pictures, first_up
from hdbench.report.elements import KeyNumber, Level, ReportFiles, Section, Table, Verdict
from hdbench.report.numbers import DASH, plain, short, unit_words, with_std
from hdbench.report.page import render_page
from hdbench.report.pagefiles import (
    NUMBER_HEAD,
    csv_text,
    number_cells,
    page_files,
    write_page,
)

__all__ = ["comparison_section", "write_comparison"]

_LEVELS: dict[str, Level] = {"within-uncertainty": "good", "moved": "look", "cannot-tell": "look"}
_ANSWERS = {
    "within-uncertainty": "Within its uncertainty",
    "moved": "Moved",
    "cannot-tell": "Cannot tell",
}
_TITLES = {
    "calibration": "Two calibrations compared",
    "misalignment": "Misalignment before and after",
    "ripple": "Torque ripple of two runs compared",
    "diagnosis": "Two diagnoses compared",
}


def write_comparison(body: Mapping[str, Any], out: Path) -> ReportFiles:
    """Write a comparison as one offline page, its numbers as CSV, and all of it as JSON."""
    files = page_files(out, option="--html", example="compare.html")
    section = comparison_section(body)
    table = csv_text(NUMBER_HEAD, (number_cells(n, n.quantity) for n in section.numbers))
    return write_page(files, render_page((section,), files), table, body)


def comparison_section(body: Mapping[str, Any]) -> Section:
    """Compose the section of a comparison."""
    a, b = body["a"], body["b"]
    name = f"{a['run_id']} (A) and {b['run_id']} (B)"
    return Section(
        name,
        "comparison",
        _TITLES[body["kind"]],
        Verdict(
            _LEVELS[body["verdict"]],
            f"{_ANSWERS[body['verdict']]}. {first_up(body['sentence'])}.",
        ),
        _doubts(body),
        _summary(body),
        _numbers(body["quantities"], name),
        comparison_pictures(body),
        _tables(body),
        _provenance(body),
        (),
    )


def _doubts(body: Mapping[str, Any]) -> tuple[str, ...]:
    found = []
    for side in ("a", "b"):
        one = body[side]
        words = [*one["doubts"], *one["flags"]]
        if one["status"] not in (None, "complete"):
            words.append(f"the run is {one['status']}")
        if words:
            found.append(f"{side.upper()}: {'; '.join(words)}.")
    return tuple(found)


def _summary(body: Mapping[str, Any]) -> str:
    share = 100.0 * body["confidence"]
    text = (
        f"B less A, each number against the expanded uncertainty of its difference at {share:g} %. "
        f"What both have in common does not count as a difference: {body['assumption']}. "
    )
    orders = body["orders"]
    if orders is not None and not orders["same_origin"] and orders["score"] is not None:
        text += (
            "The angles of the two runs have no common origin that is known, so the orders of B "
            f"were turned back by the one angle of {orders['shift_rad']:.4f} rad that brings both "
            "closest together."
        )
    if body["overlay"] is None:
        text += f" No overlay: {body['overlay_reason']}."
    return text


def _numbers(rows: Sequence[Mapping[str, Any]], source: str) -> tuple[KeyNumber, ...]:
    found = []
    for row in rows:
        step = row["difference"]
        if step is None:
            continue
        found.append(
            KeyNumber(
                f"{row['label']}, B less A",
                f"{row['name']}.difference",
                float(step["value"]),
                row["unit"],
                f"{source}: {row['name']}",
                step["std"],
                step["dof"],
                row["note"],
            )
        )
    return tuple(found)


def _shown(body: Any) -> str:
    if body is None:
        return DASH
    return with_std(body) if isinstance(body, Mapping) else short(float(body))


def _tables(body: Mapping[str, Any]) -> tuple[Table, ...]:
    rows = []
    for q in body["quantities"]:
        answer = {True: "moved", False: "within", None: DASH}[q["moved"]]
        rows.append(
            (
                q["label"] + (f" ({unit_words(q['unit'])})" if q["unit"] else ""),
                _shown(q["a"]),
                _shown(q["b"]),
                _shown(q["difference"]),
                DASH if q["expanded"] is None else short(q["expanded"], 0.5 * q["expanded"]),
                DASH if q["score"] is None else f"{q['score']:.2f}",
                f"{answer}; decides" if q["decides"] else answer,
            )
        )
    head = ("quantity", "A", "B", "B less A", "expanded", "score", "")
    note = "score: size of the difference over its expanded uncertainty; above 1 it has moved"
    tables = [Table("Numbers of both", head, tuple(rows), note)]
    if body["orders"] is not None:
        tables.append(_vectors(body["orders"]))
    for key, title in (
        ("profile_changes", "Profile keys that differ"),
        ("environment_changes", "What else differs"),
    ):
        tables.append(_changes(title, body[key]))
    return tuple(tables)


def _vectors(orders: Mapping[str, Any]) -> Table:
    rows = []
    for row in orders["orders"]:
        cells = [
            f"{_shown(row[s]['amplitude_nm'])} at {_shown(row[s]['phase_rad'])}" for s in ("a", "b")
        ]
        step = _shown(row["difference"]["amplitude_nm"])
        score = DASH if row["score"] is None else f"{row['score']:.2f}"
        rows.append((f"{row['order']:g}", *cells, step, score))
    head = ("order", "A (N·m at rad)", "B (N·m at rad)", "length of B less A (N·m)", "score")
    joint = orders["score"]
    note = "" if joint is None else f"all orders together: score {joint:.2f}"
    return Table("Orders as vectors", head, tuple(rows), note)


def _changes(title: str, changes: Sequence[Mapping[str, Any]] | None) -> Table:
    head = ("key", "A", "B")
    if changes is None:
        return Table(title, head, (), "not known: a result file alone does not tell")
    rows = tuple(
        (
            str(change["key"]),
            *("absent" if change["only"] not in ("", s) else plain(change[s]) for s in ("a", "b")),
        )
        for change in changes
    )
    return Table(title, head, rows, "" if rows else "nothing differs")


def _provenance(body: Mapping[str, Any]) -> tuple[tuple[str, str], ...]:
    rows = [("hdbench", str(body["hdbench_version"])), ("confidence", plain(body["confidence"]))]
    for side in ("a", "b"):
        one = body[side]
        rows += [
            (f"{side.upper()}", str(one["path"])),
            (f"{side.upper()} measured", plain(one["measured_utc"])),
            (f"{side.upper()} profile", plain(one["profile"])),
        ]
    return tuple((name, re.sub(r"\s+", " ", text)) for name, text in rows)
