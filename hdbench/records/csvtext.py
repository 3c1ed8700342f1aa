"""Comma-separated text: limits, rows with their lines, fast parsing of plain numbers.

Plain numbers are parsed by polars where it is installed, else by pydantic's parser. Both round a
decimal number to the nearest float64, as Python does. What is not plain (quotes, text, a row of
another length) is left to the careful reader, which names line and column.
"""

from __future__ import annotations

import csv
import gzip
import importlib
import importlib.util
import re
import zlib
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hdbench.errors import DataError
from hdbench.records.parquetfile import PARQUET, parquet_names
from hdbench.records.storage import file_bytes, read_errors
from hdbench.records.trace import FloatArray

_LIMIT_COLUMNS = 1000
_LIMIT_HEADER = 1 << 20
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
# 600 s at 5 kHz with ten channels of full precision are 0.6 GB as text
LIMIT_BYTES = 1 << 30
# text of real samples shrinks 2 to 20 times; deflate itself cannot pass 1032
LIMIT_RATIO = 300
# below this a high ratio does no harm
SMALL_BYTES = 16 << 20
IMPORT_FIX = "bring the file in with 'hdbench import' (--help shows how to name its columns)"


def data_error(path: Path, line: int, what: str, fix: str = IMPORT_FIX) -> DataError:
    """Return a `DataError` at one line of a file."""
    return DataError(what, where=f"{path}:{line}", fix=fix)


def _inflate(path: Path, packed: bytes) -> bytes:
    limit = max(SMALL_BYTES, min(LIMIT_BYTES, len(packed) * LIMIT_RATIO))
    parts: list[bytes] = []
    total, rest = 0, packed
    try:
        while rest:
            engine = zlib.decompressobj(wbits=31)
            part = engine.decompress(rest, limit - total + 1)
            total += len(part)
            if total > limit:
                raise DataError(
                    f"unpacks to more than {limit} bytes from {len(packed)}",
                    where=str(path),
                    fix="check that this is the right file, or unpack it by hand and split it",
                )
            if not engine.eof:
                raise zlib.error("the end of the file is missing")
            parts.append(part)
            rest = engine.unused_data.lstrip(b"\0")
    except zlib.error as error:
        raise DataError(
            f"damaged gzip file: {error}", where=str(path), fix="copy the file again"
        ) from error
    return b"".join(parts)


def read_raw(path: Path, what: str) -> bytes:
    r"""Read a text file, unpacked; without byte-order mark, and its lines end with ``\n``."""
    raw = file_bytes(path, limit=LIMIT_BYTES, what=what)
    if path.suffix == ".gz":
        raw = _inflate(path, raw)
    raw = raw.removeprefix(_BYTE_ORDER_MARK)
    return raw.replace(b"\r\n", b"\n") if b"\r" in raw else raw


def as_text(path: Path, raw: bytes) -> str:
    """Return what `read_raw` read as text."""
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise data_error(
            path, line, "not UTF-8 text", "save the file as UTF-8, comma separated"
        ) from error
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise data_error(path, line, "holds a NUL character; needed: plain text", "copy it again")
    return text


def read_text(path: Path, what: str) -> str:
    """Read a text file, unpacked; without byte-order mark."""
    return as_text(path, read_raw(path, what))


def safe_cell(value: object) -> object:
    """Return a cell that no spreadsheet takes for a formula."""
    if isinstance(value, str) and value.lstrip()[:1] in ("=", "+", "-", "@"):
        return f"'{value}"
    return value


@dataclass(frozen=True, slots=True)
class Table:
    """Header and cells of one file."""

    path: Path
    header: tuple[str, ...]
    rows: tuple[Sequence[str], ...]  # cells, one sequence of `len(header)` per row
    lines: Sequence[int]  # line of the file on which each row ends, from 1


def check_header(path: Path, header: Sequence[str]) -> tuple[str, ...]:
    """Return clean column names."""
    names = tuple(name.strip() for name in header)
    if len(names) == 1 and (";" in names[0] or "\t" in names[0]):
        raise data_error(path, 1, "columns are not separated by commas")
    if not any(names):
        raise data_error(path, 1, "no header row; needed: one row of column names")
    if len(names) > _LIMIT_COLUMNS:
        raise data_error(path, 1, f"{len(names)} columns; needed: at most {_LIMIT_COLUMNS}")
    if any(_is_number(name) for name in names):
        raise data_error(path, 1, "the first row holds numbers; needed: a row of column names")
    for position, name in enumerate(names):
        if not name:
            raise data_error(path, 1, f"column {position + 1} has no name")
        if name in names[:position]:
            raise data_error(path, 1, f"column {name!r} occurs twice")
    return names


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text.lower() not in ("nan", "inf", "infinity")


def _csv_lines(path: Path, text: str) -> list[tuple[int, list[str]]]:
    """Split `text` by the rules of CSV quoting; empty lines are left out."""
    reader = csv.reader(text.split("\n"), strict=True)
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
    numbered = _csv_lines(path, text)
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
    del numbered[0]
    rows = tuple(row for _, row in numbered)
    return Table(path, header, rows, [line for line, _ in numbered])


def read_header(path: Path) -> tuple[str, ...]:
    """Return the column names of a CSV file without reading the rest."""
    if path.suffix == PARQUET:
        return parquet_names(path)
    opener = gzip.open if path.suffix == ".gz" else open
    with read_errors(path), opener(path, "rb") as file:
        line = file.readline(_LIMIT_HEADER)
    line = line.removeprefix(_BYTE_ORDER_MARK)
    rows = _csv_lines(path, line.decode("utf-8", errors="replace").rstrip("\r\n"))
    return check_header(path, rows[0][1] if rows else ())


def quoted(cell: str) -> str:
    """Return a cell of text as CSV writes it."""
    if any(mark in cell for mark in ',"\n\r'):
        return '"' + cell.replace('"', '""') + '"'
    return cell


def csv_text(head: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table as CSV: floats with every digit, nothing for None."""
    lines = (
        ",".join("" if cell is None else quoted(str(cell)) for cell in row) for row in (head, *rows)
    )
    return "".join(f"{line}\n" for line in lines)


# what decimal numbers and nan are made of
_PLAIN = b"0123456789+-.eE,\nnaN"
_MINUS_ZERO = re.compile(rb"-0(?:,|$)")
# bytes converted at a time: bounds the memory that Python floats take on the way
_CHUNK_BYTES = 1 << 16
# bytes from where on polars pays: importing it takes as long as reading this much without
_WORTH_IMPORTING = 10_000_000


def parse_numbers(
    header: Sequence[str], raw: bytes, start: int, whole: int = 0
) -> dict[str, FloatArray] | None:
    """Parse rows of numbers behind the header, which ends at `start`; an empty cell is NaN.

    None where they are not plain. `whole` is the size of the file that this is a piece of.
    """
    if len(header) < 2 or start >= len(raw):
        return None
    if max(len(raw), whole) >= _WORTH_IMPORTING and importlib.util.find_spec("polars"):
        return _by_polars(header, raw, start)
    return _by_chunks(header, raw, start)


def _by_polars(header: Sequence[str], raw: bytes, start: int) -> dict[str, FloatArray] | None:
    if raw.translate(None, _PLAIN) != raw[:start].translate(None, _PLAIN):
        return None
    polars = importlib.import_module("polars")
    schema = dict.fromkeys(header, polars.Float64)
    try:
        frame = polars.read_csv(raw, quote_char=None, schema=schema)
    except polars.exceptions.PolarsError:
        return None
    # a long row is refused, but for a comma at the end of the file; a null is an empty cell, or
    # fills a short row up
    doubtful = raw.endswith(b",") or any(frame.null_count().row(0))
    if doubtful and raw.count(b",", start) != frame.height * (len(header) - 1):
        return None
    return {name: frame[name].fill_null(np.nan).to_numpy(writable=True) for name in header}


def _by_chunks(header: Sequence[str], raw: bytes, start: int) -> dict[str, FloatArray] | None:
    end = len(raw)
    while raw.endswith(b"\n", start, end):
        end -= 1
    values = np.empty((len(header), raw.count(b"\n", start, end) + 1))
    row = 0
    while start < end:
        stop = raw.find(b"\n", start + _CHUNK_BYTES, end)
        stop = end if stop < 0 else stop
        cells = plain_matrix(raw[start:stop], len(header))
        if cells is None:
            return None
        values[:, row : row + len(cells)] = cells.T
        start, row = stop + 1, row + len(cells)
    return dict(zip(header, values, strict=True)) if row else None


def plain_matrix(lines: bytes, width: int) -> FloatArray | None:
    """Parse lines of `width` numbers each; None where they are not plain."""
    if lines.translate(None, _PLAIN):
        return None
    marks = np.frombuffer(lines, dtype=np.uint8)
    commas, ends = np.flatnonzero(marks == ord(",")), np.flatnonzero(marks == ord("\n"))
    before = np.append(np.searchsorted(commas, ends), len(commas))
    if not np.array_equal(before, (width - 1) * np.arange(1, len(ends) + 2)):
        return None
    try:
        return _floats(lines.replace(b"\n", b",")).reshape(-1, width)
    except ValueError:
        return None


def _floats(cells: bytes) -> FloatArray:
    """Convert cells of plain characters; ValueError where one is no number."""
    try:
        return _json_floats(cells)
    except (ValueError, OverflowError):
        # what JSON does not know: nothing, +1, .5, 007
        return np.array([float(cell or b"nan") for cell in cells.split(b",")])


def _json_floats(cells: bytes) -> FloatArray:
    from pydantic_core import from_json

    if b"n" in cells:
        cells = cells.replace(b"nan", b"NaN")
    values = np.frombuffer(array("d", from_json(b"[" + cells + b"]")))
    if not values.all() and _MINUS_ZERO.search(cells):
        raise ValueError("JSON takes -0 for a whole number, which has no sign")
    return values
