r"""Where the table begins in files of data loggers, and which column is the time.

LabJack's LJStreamM, LJStreamUD, LJLogM and LJLogUD write tabs. Readers published by their users
(a MATLAB reader of EEG side channels, a pandas and an R reader of LJStreamUD files) agree on: date
and time of the start, one line per channel, then ``Time  v0 .. vN  y0 .. yN`` (volts as measured,
then scaled), then numbers. The time counts from the start in stream files, and from 1904-01-01 UTC
in log files (labjack.com, "Understanding Timestamps in LJLogUD and LJLogM").

DATAQ's WinDaq and its browser export commas, quoted names, perhaps a line of units below them. That
layout is described by its maker only in part; here a table is taken to begin where a column is
named time (or date) and numbers follow.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Literal

from hdbench.errors import DataError

__all__ = ["EPOCH_1904_S", "LOGGERS", "Logger", "LoggerLayout", "find_layout", "is_time_name"]

Logger = Literal["labjack", "dataq", "auto"]
LOGGERS: tuple[Logger, ...] = ("auto", "labjack", "dataq")
# 1970-01-01 in seconds since 1904-01-01: 66 years, 17 of them leap years
EPOCH_1904_S = 2_082_844_800
_TIME = re.compile(
    r"(?:(?:relative|elapsed|scan|rel\.?)[ _]*)?times?(?:[ _]*stamp)?(?![a-z]).*", re.I
)
_DATE = re.compile(r"date\b.*", re.I)
# as many lines a file may have before its table: 96 channels with a line each, and some to spare
_SEARCHED = 200
_DELIMITERS: dict[Logger, tuple[str, ...]] = {
    "labjack": ("\t", ";", ","),
    "dataq": (",", ";", "\t"),
    "auto": ("\t", ";", ","),
}


@dataclass(frozen=True, slots=True)
class LoggerLayout:
    """Where the table of a logger file is.

    Parameters
    ----------
    delimiter : str
        Character between columns.
    skip : int
        Lines before the header.
    units : tuple of str
        The line of units below the header; empty where there is none.
    preamble : tuple of str
        What stands before the header.
    """

    delimiter: str
    skip: int
    units: tuple[str, ...]
    preamble: tuple[str, ...]


def is_time_name(name: str) -> bool:
    """Return whether a column is named as a time.

    Parameters
    ----------
    name : str
        Header cell.

    Returns
    -------
    bool
    """
    return _TIME.fullmatch(name.strip()) is not None


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        row = next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        return []
    cells = [cell.strip() for cell in row]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _is_number(cell: str) -> bool:
    try:
        return Decimal(cell.replace(",", ".")).is_finite()
    except InvalidOperation:
        return False


def _is_data(cells: list[str], width: int) -> bool:
    return 2 <= len(cells) <= width and _is_number(cells[-1])


def find_layout(path: Path, text: str, logger: Logger) -> LoggerLayout:
    """Find the table in a file of a data logger.

    Parameters
    ----------
    path : Path
        The file, for messages.
    text : str
        Its text.
    logger : str
        Whose file it is; ``auto`` tries every delimiter.

    Returns
    -------
    LoggerLayout

    Raises
    ------
    DataError
        If there is no row of names with a time or a date, with numbers below it.
    """
    lines = text.split("\n", _SEARCHED)[:_SEARCHED]
    filled = [i for i, line in enumerate(lines) if line.strip()]
    for delimiter in _DELIMITERS[logger]:
        for place, at in enumerate(filled):
            names = _cells(lines[at], delimiter)
            if len(names) < 2 or not any(_TIME.fullmatch(n) or _DATE.fullmatch(n) for n in names):
                continue
            below = [_cells(lines[i], delimiter) for i in filled[place + 1 : place + 3]]
            told = tuple(line.strip() for line in lines[:at] if line.strip())
            if below and _is_data(below[0], len(names)):
                return LoggerLayout(delimiter, at, (), told)
            apart = len(below) == 2 and not any(map(_is_number, below[0]))
            if apart and _is_data(below[1], len(names)):
                return LoggerLayout(delimiter, at, tuple(below[0]), told)
    raise DataError(
        "no row of column names with a time and numbers below it",
        where=str(path),
        fix="say where the table begins: --skip LINES and --delimiter, without --from-logger; "
        "without names --no-header and --rate HZ",
    )
