"""Logs of other programs as tables of text, whatever separates their columns."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

from hdbench.errors import DataError
from hdbench.records.loggers import Logger, LoggerLayout, find_layout
from hdbench.records.table import csv_lines
from hdbench.records.textfile import data_error, read_text
from hdbench.records.units import bare_name, stated_unit

__all__ = ["ForeignFormat", "ForeignTable", "read_foreign"]

_DELIMITERS = ("\t", ";", ",")
_PROBE_ROWS = 50
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_MISSING = ("", "nan", "na", "n/a", "-nan", "nan(ind)", "-nan(ind)", "null")


@dataclass(frozen=True, slots=True)
class ForeignFormat:
    """How a foreign file is laid out.

    Parameters
    ----------
    delimiter : str or None
        Character between columns; None finds it.
    header : bool
        Whether the first row names the columns.
    skip : int
        Lines before the header (or the data) that are passed over.
    logger : str or None
        Data logger that wrote the file, or ``auto``: the table is then looked for behind `skip`.
    """

    delimiter: str | None = None
    header: bool = True
    skip: int = 0
    logger: Logger | None = None


@dataclass(frozen=True, slots=True)
class ForeignTable:
    """One foreign file.

    Parameters
    ----------
    path : Path
        The file.
    header : tuple of str
        Column names; empty without a header row.
    width : int
        Number of columns.
    rows : list of list of str
        Cells.
    lines : list of int
        Line of the file for each row.
    decimal_comma : bool
        Whether numbers are written with a decimal comma.
    units : tuple of str
        Unit of each column as the file states it, empty text where it states none.
    preamble : tuple of str
        What a logger wrote before the header.
    logged : bool
        Whether the table was found as a logger's.
    """

    path: Path
    header: tuple[str, ...]
    width: int
    rows: list[list[str]]
    lines: list[int]
    decimal_comma: bool
    units: tuple[str, ...] = ()
    preamble: tuple[str, ...] = ()
    logged: bool = False

    def column(self, name: str) -> int | None:
        """Return the position of a column by name or by number from 1; None if there is none.

        The unit in brackets behind a name may be left out where that leaves no doubt.
        """
        if name in self.header:
            return self.header.index(name)
        bare = [i for i, full in enumerate(self.header) if bare_name(full) == name]
        if len(bare) == 1:
            return bare[0]
        if name.isascii() and name.isdigit() and 1 <= int(name[:6]) <= self.width:
            return int(name) - 1
        return None

    def is_numeric(self, column: int) -> bool:
        """Return whether the first cell of a column is a number."""
        if not self.rows:
            return False
        try:
            return self.decimal(0, column) is not None
        except DataError:
            return False

    def decimal(self, row: int, column: int) -> Decimal | None:
        """Return one cell as an exact decimal number.

        Parameters
        ----------
        row, column : int
            Positions from 0.

        Returns
        -------
        Decimal or None
            None for an empty cell or one that says that there is no number.

        Raises
        ------
        DataError
            If the cell is neither.
        """
        word = self.rows[row][column].strip()
        if word.lower() in _MISSING:
            return None
        if self.decimal_comma:
            word = word.replace(",", ".")
        try:
            value = Decimal(word) if word.isascii() and "_" not in word else Decimal("inf")
        except InvalidOperation:
            value = Decimal("inf")
        # beyond these a double overflows
        if not (value.is_finite() and value.adjusted() < 308):
            name = self.header[column] if self.header else f"number {column + 1}"
            raise data_error(
                self.path,
                self.lines[row],
                f"column {name} holds {self.rows[row][column][:40]!r}; needed: a finite number",
                "correct the cell, empty it, or pass lines before the data over with --skip",
            )
        return value


def _find_delimiter(path: Path, text: str) -> str:
    probe = "\n".join(text.split("\n", _PROBE_ROWS)[:_PROBE_ROWS])
    for delimiter in _DELIMITERS:
        try:
            widths = {len(row) for _, row in csv_lines(path, probe, delimiter)}
        except DataError:
            continue
        if len(widths) == 1 and min(widths) > 1:
            return delimiter
    return ","


def _uses_decimal_comma(rows: Sequence[Sequence[str]], delimiter: str) -> bool:
    """Return whether numbers are like 1,5 and none is like 1.5."""
    found = False
    for row in rows[:1000]:
        for cell in row:
            word = cell.strip()
            if _COMMA_NUMBER.fullmatch(word):
                found = True
            elif "." in word and _COMMA_NUMBER.fullmatch(word.replace(".", ",", 1)):
                return False
    return found


def _even(
    path: Path, numbered: list[tuple[int, list[str]]], width: int
) -> tuple[list[list[str]], list[int]]:
    rows, lines = [], []
    for line, row in numbered:
        if len(row) > width and not any(cell.strip() for cell in row[width:]):
            row = row[:width]
        if len(row) != width:
            raise data_error(
                path,
                line,
                f"{len(row)} cells; needed: {width}",
                "check --delimiter, or pass lines before the header over with --skip",
            )
        rows.append(row)
        lines.append(line)
    return rows, lines


def _names(path: Path, line: int, row: Sequence[str]) -> tuple[str, ...]:
    names = [cell.strip() for cell in row]
    while names and not names[-1]:
        names.pop()
    digits = sum(bool(re.fullmatch(r"[+-]?\d+([.,]\d+)?([eE][+-]?\d+)?", name)) for name in names)
    if not names or 2 * digits > len(names):
        raise data_error(
            path, line, "the first row holds no column names", "say --no-header, or --skip lines"
        )
    return tuple(names)


def read_foreign(path: Path, layout: ForeignFormat) -> ForeignTable:
    """Read a log of another program.

    Parameters
    ----------
    path : Path
        Text file in UTF-8, with or without byte order mark; ``.gz`` is unpacked.
    layout : ForeignFormat
        How it is laid out.

    Returns
    -------
    ForeignTable

    Raises
    ------
    DataError
        If the file is missing or damaged, holds no data, or a row has another number of cells
        (with its line).
    """
    path = Path(path)
    text = read_text(path, "log", keep_bom=False)
    lines = text.split("\n")
    text = "\n".join(lines[layout.skip :])
    found = None if layout.logger is None else find_layout(path, text, layout.logger)
    skip = layout.skip + (0 if found is None else found.skip)
    text = "\n".join(lines[skip:])
    delimiter = layout.delimiter or _find_delimiter(path, text)
    if found is not None:
        delimiter = found.delimiter
    numbered = [
        (line + skip, row)
        for line, row in csv_lines(path, text, delimiter)
        if any(cell.strip() for cell in row)
    ]
    if len(numbered) <= layout.header:
        raise DataError("no data", where=str(path), fix="check the file, or a smaller --skip")
    return _table(path, numbered, layout.header, delimiter, found)


def _table(
    path: Path,
    numbered: list[tuple[int, list[str]]],
    named: bool,
    delimiter: str,
    found: LoggerLayout | None,
) -> ForeignTable:
    header: tuple[str, ...] = ()
    width = len(numbered[0][1])
    if named:
        header = _names(path, *numbered[0])
        width = len(header)
        numbered = numbered[1:]
    units = tuple(stated_unit(name) for name in header)
    if found is not None and found.units:
        units = tuple([*found.units, *[""] * width][:width])
        numbered = numbered[1:]
    rows, places = _even(path, numbered, width)
    comma = _uses_decimal_comma(rows, delimiter)
    told = () if found is None else found.preamble
    logged = found is not None
    return ForeignTable(path, header, width, rows, places, comma, units, told, logged)
