"""The three files of a page: HTML, its numbers as CSV, all of it as JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.errors import DataError, UsageError
from hdbench.records.jsonfile import write_json
from hdbench.records.storage import storage_error, write_atomic
from hdbench.report.pagemodel import KeyNumber

_NUMBER_HEAD = ("quantity", "value", "std", "dof", "unit", "source")
# the first bytes of every file that a report makes hold one of these
_MARKS = {
    ".html": ("hdbench</title>",),
    ".htm": ("hdbench</title>",),
    ".csv": (
        ",".join(_NUMBER_HEAD),
        "part,group,torque_nm,name,value,unit",
        "case,key,what,expected,found,allowed,in_tolerances,regression",
        "name,series,unit,run,time_utc,value,std",
        "kind,drive,run,figure,value,std,score,outlier",
    ),
    ".json": tuple(
        f'"schema": "hdbench/{kind}/'
        for kind in ("report", "comparison", "regression", "trend", "fleet")
    ),
}
# the title stands behind the page's security policy, the schema on the first lines
_HEAD_BYTES = 4096


@dataclass(frozen=True, slots=True)
class ReportFiles:
    """Where a report was written.

    Parameters
    ----------
    html, csv, json : Path
        The page, its key numbers as a table, and both as data.
    """

    html: Path
    csv: Path
    json: Path


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


def refuse_foreign(files: Iterable[Path]) -> None:
    """Refuse to write over a file that no report made."""
    for file in files:
        if not file.exists():
            continue
        if not file.is_file():
            raise DataError(
                "not a regular file", where=str(file), fix="name another file with --out"
            )
        try:
            with file.open("rb") as stream:
                head = stream.read(_HEAD_BYTES).decode("utf-8", errors="replace")
        except OSError as error:
            raise storage_error(error, file) from error
        if head and not any(mark in head for mark in _MARKS.get(file.suffix.lower(), ())):
            raise UsageError(
                "the file exists and is no report's; a report writes .html, .csv and .json of "
                "one name",
                where=str(file),
                fix="name another file with --out, or move this one away",
            )


def csv_text(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()


def numbers_csv(named: Iterable[tuple[str, KeyNumber]]) -> str:
    """Return key numbers with their names as CSV, with every digit."""
    rows = []
    for name, n in named:
        std, dof = ("" if x is None else repr(float(x)) for x in (n.std, n.dof))
        rows.append((name, repr(n.value), std, dof, n.unit, n.source))
    return csv_text(_NUMBER_HEAD, rows)


def write_page(files: ReportFiles, page: str, table: str, body: Mapping[str, Any]) -> ReportFiles:
    """Write the three files."""
    write_atomic(files.html, page.encode("utf-8"))
    write_atomic(files.csv, table.encode("utf-8"))
    write_json(files.json, body)
    return files
