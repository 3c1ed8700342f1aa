"""The three files of a page: HTML, its numbers as CSV, all of it as JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hdbench.errors import UsageError
from hdbench.records.jsonfile import write_json
from hdbench.records.storage import storage_error, write_atomic
from hdbench.report.elements import KeyNumber, ReportFiles
from hdbench.report.ours import refuse_foreign

__all__ = ["NUMBER_HEAD", "csv_text", "is_page", "number_cells", "page_files", "write_page"]

NUMBER_HEAD = ("quantity", "value", "std", "dof", "unit", "source")
"""Columns of key numbers."""


def is_page(path: Path) -> bool:
    """Return whether a path names a page rather than a folder."""
    return path.suffix.lower() in (".html", ".htm")


def page_files(html: Path, *, option: str = "", example: str = "") -> ReportFiles:
    """Return the files of a page, with their folder made."""
    if not is_page(html):
        raise UsageError(
            f"{html.name!r} does not end in .html", where=option, fix=f"name it such as {example}"
        )
    try:
        html.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise storage_error(error, html.parent) from error
    files = ReportFiles(html, html.with_suffix(".csv"), html.with_suffix(".json"))
    refuse_foreign((files.html, files.csv, files.json))
    return files


def csv_text(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()


def number_cells(number: KeyNumber, name: str) -> tuple[str, ...]:
    """Return the row of one key number, with every digit."""
    std, dof = ("" if x is None else repr(float(x)) for x in (number.std, number.dof))
    return (name, repr(number.value), std, dof, number.unit, number.source)


def write_page(files: ReportFiles, page: str, table: str, body: Mapping[str, Any]) -> ReportFiles:
    """Write the three files."""
    write_atomic(files.html, page.encode("utf-8"))
    write_atomic(files.csv, table.encode("utf-8"))
    write_json(files.json, body)
    return files
