"""Page of a comparison with stored results: what moved in each case, and by how much."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hdbench.records.csvtext import csv_text
from hdbench.report.canvas import score_chart
from hdbench.report.numbers import MINUS, plain
from hdbench.report.page import ReportFiles, page_files, write_page
from hdbench.report.pagemodel import Picture, Section, Table, Verdict
from hdbench.report.texts import page_text

_CSV_HEAD = ("case", "key", "what", "expected", "found", "allowed", "in_tolerances", "regression")
# rows of one figure that can still be read
_MOST_ROWS = 30
# characters of a text that one is compared by; CSV and JSON hold all
_LONGEST = 24


def write_regression(body: Mapping[str, Any], out: Path) -> ReportFiles:
    """Write a comparison with stored results as one offline page, with CSV and JSON beside it."""
    files = page_files(out, option="--report", example="regress.html")
    sections = [_section(case, body, number) for number, case in enumerate(body["cases"], start=1)]
    table = csv_text(
        _CSV_HEAD,
        (
            (case["name"], *(change[key] for key in _CSV_HEAD[1:]))
            for case in body["cases"]
            for change in case["changes"]
        ),
    )
    title, foot = "Stored results evaluated again", page_text("regression_foot")
    return write_page(files, sections, table, body, title=title, noun="cases", foot=foot)


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
        pictures=() if picture is None else (picture,),
        tables=_tables(changes),
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
    beyond = [change for change in changes if change["regression"]]
    allowed = [change for change in changes if not change["regression"]]
    return Table.filled(
        Table.told("regression", beyond, title="Beyond tolerance", told=_told),
        Table.told("regression", allowed, title="Changed, but allowed", told=_told),
    )


def _told(value: object) -> str:
    """Return a value with the digits in which it may have moved, a long text cut."""
    if isinstance(value, float):
        return f"{value:.12g}".replace("-", MINUS)
    text = plain(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"


def _picture(changes: Sequence[Mapping[str, Any]], name: str) -> Picture | None:
    """Draw how far each number moved, in tolerances; None where no number did."""
    told = [
        (str(change["key"]), float(change["in_tolerances"]), True)
        for change in changes
        if change["in_tolerances"] is not None and change["what"] == "moved"
    ]
    if not told:
        return None
    shown = sorted(told, key=lambda row: -row[1])[:_MOST_ROWS]
    figure = score_chart(shown, "how far it moved, in tolerances")
    rest = f" The {len(shown)} largest of {len(told)}." if len(told) > len(shown) else ""
    largest = f"{shown[0][0]} by {shown[0][1]:.3g}"
    numbers = {"count": len(shown), "largest": largest, "rest": rest}
    return Picture.drawn(figure, name, "changes", **numbers)
