"""Comma-separated text as rows, with the line of every row and errors that name it."""

from __future__ import annotations

import csv
import gzip
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hdbench.errors import DataError
from hdbench.records.parquetfile import PARQUET, parquet_names
from hdbench.records.textfile import data_error

__all__ = [
    "Table",
    "check_header",
    "csv_lines",
    "parse_table",
    "quoted",
    "read_header",
    "safe_cell",
]

_LIMIT_COLUMNS = 1000
_LIMIT_HEADER = 1 << 20


def safe_cell(value: object) -> object:
    """Return a cell that no spreadsheet takes for a formula."""
    if isinstance(value, str) and value.lstrip()[:1] in ("=", "+", "-", "@"):
        return f"'{value}"
    return value


@dataclass(frozen=True, slots=True)
class Table:
    """Header and cells of one file.

    Parameters
    ----------
    path : Path
        The file.
    header : tuple of str
        Column names.
    rows : tuple of sequence of str
        Cells, one sequence of ``len(header)`` per row.
    lines : sequence of int
        Line of the file on which each row ends, from 1.
    """

    path: Path
    header: tuple[str, ...]
    rows: tuple[Sequence[str], ...]
    lines: Sequence[int]


def check_header(path: Path, header: Sequence[str]) -> tuple[str, ...]:
    """Return clean column names."""
    names = tuple(name.strip() for name in header)
    if names and names[0].startswith("\ufeff"):
        raise data_error(path, 1, "starts with a byte order mark; needed: UTF-8 without one")
    if len(names) == 1 and (";" in names[0] or "\t" in names[0]):
        raise data_error(path, 1, "columns are not separated by commas")
    if not any(names):
        raise data_error(path, 1, "no header row; needed: one row of column names")
    if len(names) > _LIMIT_COLUMNS:
        raise data_error(path, 1, f"{len(names)} columns; needed: at most {_LIMIT_COLUMNS}")
    if any(_is_number(name) for name in names):
        raise data_error(path, 1, "the first row holds numbers; needed: a row of column names")
    seen: set[str] = set()
    for position, name in enumerate(names, 1):
        if not name:
            raise data_error(path, 1, f"column {position} has no name")
        if name in seen:
            raise data_error(path, 1, f"column {name!r} stands twice")
        seen.add(name)
    return names


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text.lower() not in ("nan", "inf", "infinity")


def csv_lines(path: Path, text: str, delimiter: str = ",") -> list[tuple[int, list[str]]]:
    """Split `text` by the rules of CSV quoting; empty lines are left out."""
    reader = csv.reader(text.split("\n"), delimiter=delimiter, strict=True)
    rows = []
    start = 1  # line on which the row that is being read begins
    try:
        for row in reader:
            if row:
                rows.append((reader.line_num, row))
            start = reader.line_num + 1
    except csv.Error as error:
        raise data_error(path, start, f"not a CSV row: {error}") from error
    return rows


def parse_table(path: Path, text: str) -> Table:
    """Split the text of a file that follows the contract into header and rows."""
    numbered = csv_lines(path, text)
    if not numbered:
        raise data_error(
            path, 1, "the file is empty; needed: a header row and data", "copy it again"
        )
    header = check_header(path, numbered[0][1])
    for line, row in numbered[1:]:
        if len(row) != len(header):
            raise data_error(
                path, line, f"{len(row)} cells; needed: {len(header)}, one for each column"
            )
    if len(numbered) < 2:
        raise data_error(path, 1, "a header without data; needed: at least one row", "record again")
    return Table(
        path, header, tuple(row for _, row in numbered[1:]), [line for line, _ in numbered[1:]]
    )


def read_header(path: Path) -> tuple[str, ...]:
    """Return the column names of a CSV file without reading the rest."""
    if path.suffix == PARQUET:
        return parquet_names(path)
    opener = gzip.open if path.suffix == ".gz" else open
    try:
        with opener(path, "rb") as file:
            line = file.readline(_LIMIT_HEADER)
    except (OSError, EOFError, zlib.error, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise DataError(
            f"cannot read: {reason}", where=str(path), fix="check path and rights"
        ) from error
    text = line.decode("utf-8", errors="replace").rstrip("\r\n")
    rows = csv_lines(path, text)
    return check_header(path, rows[0][1] if rows else ())


def quoted(cell: str) -> str:
    """Return a cell of text as CSV writes it."""
    if any(mark in cell for mark in ',"\n\r'):
        return '"' + cell.replace('"', '""') + '"'
    return cell
