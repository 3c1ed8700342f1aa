"""The page of a comparison with stored results: what moved in each case, and by how much."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.report.canvas import COLOURS, draw_svg, label_axes, new_figure
from hdbench.report.elements import Picture, ReportFiles, Section, Table, Verdict
from hdbench.report.numbers import DASH, MINUS, plain, short
from hdbench.report.page import PageWords, render_page
from hdbench.report.pagefiles import csv_text, page_files, write_page

__all__ = ["write_regression"]

_CSV_HEAD = ("case", "key", "what", "expected", "found", "allowed", "in_tolerances", "regression")
_FOOT = (
    "A quantity may move by its tolerance; the reason for each tolerance stands beside it. "
    "Quantities that are new, and those that carry no result, are told but do not fail the case."
)
# rows of one figure that can still be read
_MOST_ROWS = 30
# characters of a text that one is compared by; CSV and JSON hold all
_LONGEST = 24
# what moved by less stands at the left edge of the figure: a logarithm has no place for 0
_LEAST = 1e-2


def write_regression(body: Mapping[str, Any], out: Path) -> ReportFiles:
    """Write a comparison with stored results as one offline page, with CSV and JSON beside it."""
    files = page_files(out, option="--report", example="regress.html")
    sections = [_section(case, body, number) for number, case in enumerate(body["cases"], start=1)]
    words = PageWords("Stored results evaluated again", "cases", _FOOT)
    table = csv_text(_CSV_HEAD, _rows(body["cases"]))
    return write_page(files, render_page(sections, files, words), table, body)


def _section(case: Mapping[str, Any], body: Mapping[str, Any], number: int) -> Section:
    changes = case["changes"]
    picture = _picture(changes, f"case-{number}")
    error = case["error"]
    return Section(
        f"{body['folder']}/{case['name']}",
        "regression",
        case["name"] if case["name"] == case["kind"] else f"{case['name']} ({case['kind']})",
        _verdict(case),
        () if error is None else (f"{error['where']}: {error['what']}. Fix: {error['fix']}.",),
        "",
        (),
        () if picture is None else (picture,),
        _tables(changes),
        (),
        (),
    )


def _verdict(case: Mapping[str, Any]) -> Verdict:
    moved = sum(change["regression"] for change in case["changes"])
    count = case["compared"]
    if case["error"] is not None:
        return Verdict("bad", "Not compared: the case is invalid.")
    if case["updated"]:
        return Verdict("look", f"Updated: {len(case['changes'])} expected values were replaced.")
    if moved:
        return Verdict("look", f"Moved: {moved} of {count} quantities are beyond their tolerance.")
    return Verdict("good", f"Nothing moved: {count} quantities are within their tolerances.")


def _tables(changes: Sequence[Mapping[str, Any]]) -> tuple[Table, ...]:
    head = ("quantity", "expected", "found", "tolerance", "in tolerances", "why this tolerance")
    found = []
    for regression, title in ((True, "Beyond tolerance"), (False, "Told, but allowed")):
        rows = tuple(_row(change) for change in changes if change["regression"] is regression)
        if rows:
            found.append(Table(title, head, rows, wide=True))
    return tuple(found)


def _row(change: Mapping[str, Any]) -> tuple[str, ...]:
    before = "absent" if change["what"] == "new" else _told(change["expected"])
    after = "absent" if change["what"] == "missing" else _told(change["found"])
    sizes = (change["allowed"], change["in_tolerances"])
    cells = (DASH if size is None else short(float(size)) for size in sizes)
    return (str(change["key"]), before, after, *cells, str(change["reason"]))


def _told(value: object) -> str:
    """Return a value with the digits in which it may have moved, a long text cut."""
    if isinstance(value, float):
        return f"{value:.12g}".replace("-", MINUS)
    text = plain(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"


def _picture(changes: Sequence[Mapping[str, Any]], name: str) -> Picture | None:
    """Draw how far each number moved, in tolerances; None where no number did."""
    told = sorted(
        (c for c in changes if c["in_tolerances"] is not None and c["what"] == "moved"),
        key=lambda change: -float(change["in_tolerances"]),
    )
    shown = told[:_MOST_ROWS]
    if not shown:
        return None
    figure, (axes,) = new_figure(1, 0.9 + 0.3 * len(shown))
    places = np.arange(len(shown))[::-1]
    sizes = np.array([max(float(change["in_tolerances"]), _LEAST) for change in shown])
    axes.axvline(1.0, color=COLOURS["expected"], linestyle="--")
    axes.plot(sizes, places, "o", color=COLOURS["filtered"])
    axes.set_xscale("log")
    last = math.ceil(math.log10(max(10.0, 1.5 * float(sizes.max()))))
    axes.set_xlim(0.7 * _LEAST, 10.0**last)
    axes.set_xticks([], minor=True)
    axes.set_ylim(-0.6, len(shown) - 0.4)
    axes.set_yticks(places, [str(change["key"]) for change in shown])
    label_axes(axes, "how far it moved, in tolerances", "")
    rest = f" The {len(shown)} largest of {len(told)}." if len(told) > len(shown) else ""
    caption = f"To the right of the dashed line a number is beyond its tolerance.{rest}"
    largest = f"{shown[0]['key']} by {shown[0]['in_tolerances']:.3g}"
    alt = f"{len(shown)} numbers that moved, in tolerances; the largest is {largest}."
    return Picture("How far each number moved", caption, alt, draw_svg(figure, name, alt))


def _rows(cases: Sequence[Mapping[str, Any]]) -> Iterator[tuple[Any, ...]]:
    for case in cases:
        for change in case["changes"]:
            yield (case["name"], *(change[key] for key in _CSV_HEAD[1:]))
