"""Foreign samples as one trace."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

import numpy as np

from hdbench.errors import DataError, UsageError
from hdbench.records.foreign import ForeignTable
from hdbench.records.mapping import find_source
from hdbench.records.textfile import data_error
from hdbench.records.trace import FloatArray, Trace

__all__ = ["joined_trace"]


@dataclass(frozen=True, slots=True)
class _Part:
    """One file: exact times and float channels."""

    table: ForeignTable
    times: list[Fraction]
    columns: Mapping[str, FloatArray]


def _times(table: ForeignTable, source: str) -> list[Fraction]:
    """Return the times of a file, s, exactly as its decimals say; they must increase."""
    column = find_source(table, source, "--time")
    scale, offset = Fraction(column.scale), Fraction(column.offset)
    times: list[Fraction] = []
    for row, line in enumerate(table.lines):
        cell = table.decimal(row, column.index)
        if cell is None:
            raise data_error(
                table.path, line, "no time in this row; needed: one in every row", "give it a time"
            )
        time = Fraction(cell) * scale + offset
        if times and not time > times[-1]:
            word = "repeats" if time == times[-1] else "goes back behind"
            raise data_error(
                table.path,
                line,
                f"time {cell} {word} that of line {table.lines[row - 1]}; "
                "needed: strictly increasing",
                "take the row out, or use --rate if the time column is too coarse",
            )
        times.append(time)
    return times


def _channel(table: ForeignTable, source: str) -> FloatArray:
    column = find_source(table, source, "--map")
    plain = column.scale == 1 and column.offset == 0
    values = np.empty(len(table.rows))
    for row in range(len(table.rows)):
        cell = table.decimal(row, column.index)
        if cell is None:
            values[row] = np.nan
        else:
            values[row] = float(cell if plain else cell * column.scale + column.offset)
    return values


def _constant(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise UsageError(
            f"{name}={text!r:.40}; needed: a finite number", where="--set", fix="give a number"
        )
    return value


def _part(
    table: ForeignTable,
    sources: Mapping[str, str],
    constants: Mapping[str, str],
    rate: Fraction | None,
) -> _Part:
    if rate is not None:
        times = [Fraction(k) / rate for k in range(len(table.rows))]
    elif "time_s" in sources:
        times = _times(table, sources["time_s"])
    else:
        raise UsageError(
            f"no time for {table.path}",
            where="--time, --rate",
            fix="give --time COLUMN or --rate HZ",
        )
    columns = {n: _channel(table, s) for n, s in sources.items() if n != "time_s"}
    for name, text in constants.items():
        columns[name] = np.full(len(times), _constant(name, text))
    return _Part(table, times, columns)


def _ordered(parts: Sequence[_Part]) -> list[_Part]:
    ordered = sorted(parts, key=lambda part: part.times[0])
    for before, after in itertools.pairwise(ordered):
        if not after.times[0] > before.times[-1]:
            raise data_error(
                after.table.path,
                after.table.lines[0],
                f"starts at {float(after.times[0])!r} s, before {before.table.path} ends at "
                f"{float(before.times[-1])!r} s; needed: files that follow one another",
                "import them one by one, or shift one by --map N:time_s=COLUMN+OFFSET",
            )
        if set(after.columns) != set(before.columns):
            odd = sorted(set(after.columns) ^ set(before.columns))
            raise UsageError(
                f"column {odd[0]!r} is not in all files", where="--map", fix="map it in each file"
            )
    return ordered


def _follow_on(parts: list[_Part], rate: Fraction) -> list[_Part]:
    """Count the time on from file to file."""
    shifted, start = [], Fraction(0)
    for part in parts:
        shifted.append(_Part(part.table, [time + start for time in part.times], part.columns))
        start += len(part.times) / rate
    return shifted


def joined_trace(
    tables: Sequence[ForeignTable],
    sources: Sequence[Mapping[str, str]],
    constants: Sequence[Mapping[str, str]],
    *,
    rate_hz: float | None = None,
    keep_time: bool = False,
) -> tuple[Trace, Decimal | None]:
    """Join foreign samples into one trace.

    Parameters
    ----------
    tables : sequence of ForeignTable
        The files.
    sources, constants : sequence of mapping
        For each file: source of each column, value of each constant column.
    rate_hz : float, optional
        Sample rate where there is no time column, Hz; files then follow one another.
    keep_time : bool
        Keep the time as it is; else the first sample is at 0 and differences are those of the
        decimals in the file, rounded once.

    Returns
    -------
    trace : Trace
    origin : Decimal or None
        Time that became 0, s; None where the time was kept.

    Raises
    ------
    UsageError
        If a column is missing or a constant is no number.
    DataError
        If a cell is no number, a time repeats or goes back, or files overlap (with lines).
    """
    rate = None if rate_hz is None else Fraction(rate_hz)
    parts = [_part(t, s, c, rate) for t, s, c in zip(tables, sources, constants, strict=True)]
    parts = _ordered(parts) if rate is None else _follow_on(parts, rate)
    start = Fraction(0) if keep_time else parts[0].times[0]
    names = list(parts[0].columns)
    joined = {"time_s": np.array([float(t - start) for part in parts for t in part.times])}
    for name in names:
        joined[name] = np.concatenate([part.columns[name] for part in parts])
    if not (np.diff(joined["time_s"]) > 0.0).all():
        raise DataError(
            "times fall together when rounded to doubles",
            where=str(parts[0].table.path),
            fix="leave --keep-time out, so that the time starts at 0",
        )
    origin = None if keep_time else Decimal(start.numerator) / Decimal(start.denominator)
    return Trace(joined, str(parts[0].table.path)), origin
