"""Excel workbooks, by openpyxl: each sheet is a table of cells, read row by row."""

from __future__ import annotations

import importlib
import zipfile
from collections.abc import Iterator
from datetime import datetime, time, timedelta
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.importing.layout import SEARCHED_LINES, table_layout
from hdbench.importing.readers.text import CellsSource, CellTable
from hdbench.importing.source import Source, listed
from hdbench.records.csvtext import data_error

_FORM = "Excel workbook"
# texts that cells share are read as a whole; numbers are not among them
_MOST_SHARED_BYTES = 64 << 20


def open_file(path: Path) -> Source:
    """Open a workbook."""
    with zipfile.ZipFile(path) as archive:
        for member in archive.infolist():
            sheet = member.filename.startswith("xl/worksheets/")
            if not sheet and member.file_size > _MOST_SHARED_BYTES:
                raise DataError(
                    f"{member.filename:.60} of {member.file_size} bytes; "
                    f"needed: at most {_MOST_SHARED_BYTES}",
                    where=str(path),
                    fix="save the sheet as .csv",
                )
    openpyxl: Any = importlib.import_module("openpyxl")
    book = openpyxl.load_workbook(path, read_only=True, data_only=True, keep_links=False)
    tables: list[CellTable] = []
    empty: list[str] = []
    sheets = [sheet for sheet in book.worksheets if hasattr(sheet, "iter_rows")]
    for sheet in sheets:
        head = [*islice(_cells(sheet), SEARCHED_LINES)]
        widest = max((len(cells) for _, cells in head), default=0)
        head = [(n, [*map(_text, cells), *[""] * widest][:widest]) for n, cells in head]
        layout = table_layout(head, ",", named=True)
        if layout is None:
            empty.append(sheet.title)
            continue
        prefix = f"{sheet.title}/" if len(sheets) > 1 else ""
        width, start = layout.width, layout.start
        tables.append(CellTable(layout, partial(_rows, path, sheet, start, width), prefix))
    if not tables:
        raise DataError(
            f"no table of numbers; found sheets: {listed(empty)}",
            where=str(path),
            fix="check the file; numbers that are stored as text need a number format",
        )
    return CellsSource(path, _FORM, tables, book.close, _text)


def _cells(sheet: Any) -> Iterator[tuple[int, list[Any]]]:
    """Yield the number and the cells of the rows that hold something."""
    # what the sheet claims of its size may be wrong either way
    sheet.reset_dimensions()
    for number, row in enumerate(sheet.iter_rows(values_only=True), 1):
        if any(map(_text, row)):
            yield number, [*row]


def _text(cell: object) -> str:
    """Return a cell as text; a time of day or a duration in s."""
    if cell is None or isinstance(cell, bool):
        return "" if cell is None else str(int(cell))
    if isinstance(cell, float | int):
        return repr(cell)
    if isinstance(cell, timedelta):
        return repr(cell.total_seconds())
    if isinstance(cell, time):
        return repr(cell.hour * 3600 + cell.minute * 60 + cell.second + cell.microsecond * 1e-6)
    if isinstance(cell, datetime):
        return cell.isoformat()
    return str(cell).strip()


def _rows(
    path: Path, sheet: Any, start: int, width: int, done: int
) -> Iterator[tuple[int, list[Any]]]:
    for number, cells in islice(_cells(sheet), done, None):
        if number < start:
            continue
        if any(map(_text, cells[width:])):
            what = f"{len(cells)} cells; needed: {width}"
            raise data_error(path, number, what, "take what stands beside the table out")
        yield number, [*cells, *[None] * width][:width]
