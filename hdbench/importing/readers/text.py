"""Tables of text: delimited files, and what else comes as rows of cells."""

from __future__ import annotations

import codecs
import csv
import gzip
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import DataError
from hdbench.importing.layout import (
    SEARCHED_LINES,
    TableLayout,
    is_comment,
    is_number,
    is_time_or_date,
    split,
    stamp_seconds,
    text_layout,
    uses_decimal_comma,
)
from hdbench.importing.source import Channel, Piece, Source, damaged, piece_rows, text_cells
from hdbench.importing.units import is_time_name, stated_unit
from hdbench.records.csvtext import LIMIT_RATIO, SMALL_BYTES, data_error, parse_numbers
from hdbench.records.trace import FloatArray

if TYPE_CHECKING:
    # the process that reads workbooks has no use for it
    from hdbench.importing.recipe import Recipe

# no line of a table is longer: a thousand columns of a hundred characters
_LONGEST_LINE = 1 << 20
# bytes that are converted at a time
_CHUNK_BYTES = 1 << 23
_Rows = Callable[[int], Iterator[tuple[int, list[Any]]]]
_NUMBERS = frozenset((float, int, type(None)))


@dataclass(frozen=True, slots=True)
class CellTable:
    """One table of cells."""

    layout: TableLayout  # names and width
    rows: _Rows  # yields the line and the cells of each row of data behind as many as it is told
    prefix: str = ""  # what stands before the names, such as the name of a sheet and `/`
    # yields rows of numbers as long as there are no others: their columns, and their lines; no
    # column where the table ends with them
    plain: Callable[[], Iterator[tuple[list[FloatArray], bytes]]] | None = None


class CellsSource(Source):
    """Tables of cells as a source of channels."""

    def __init__(
        self,
        path: Path,
        form: str,
        tables: Sequence[CellTable],
        close: Callable[[], None] | None = None,
        text: Callable[[Any], str] = str,
    ) -> None:
        super().__init__(path, form, close)
        self._text = text
        self._tables = {table.prefix: table for table in tables}
        made: list[tuple[Channel, int]] = []
        probes: list[list[str]] = []
        stamps: list[str] = []
        for table in tables:
            layout = table.layout
            first = [[*map(text, row)] for _, row in islice(table.rows(0), SEARCHED_LINES)]
            probes += first
            for k in range(layout.width):
                name = layout.names[k] if layout.names else str(k + 1)
                unit = (layout.units[k] if layout.units else "") or stated_unit(name)
                stamped = bool(first) and stamp_seconds(first[0][k]) is not None
                timed = bool(first) and is_number(first[0][k]) and is_time_name(name)
                if stamped:
                    unit = "s"
                    stamps.append(f"{table.prefix}{name} holds stamps: seconds are made of them")
                channel = Channel(f"{table.prefix}{name}", unit, table.prefix, timed or stamped)
                made.append((channel, k))
        self.notes = tuple(stamps)
        self._columns = self.hold(made)
        self.decimal_comma = uses_decimal_comma(probes)

    def pieces(self, names: Sequence[str]) -> Iterator[Piece]:
        """Yield cells of text, or numbers where they may be rounded."""
        clocks = {c.name: c.clock for c in self.channels}
        columns = {name: self._columns[name] for name in names}
        table = self._tables[clocks[names[0]]]
        done = 0
        if table.plain is not None and not self.rounded.isdisjoint(names):
            for values, text in table.plain():
                if not values:
                    return
                yield {
                    name: values[k]
                    if name in self.rounded
                    else _column(text, table.layout.delimiter, k)
                    for name, k in columns.items()
                }
                done += len(values[0])
        # a cell of text takes as much memory as eight numbers
        most = piece_rows(8 * table.layout.width)
        rows = (row for _, row in table.rows(done))
        while some := list(islice(rows, most)):
            yield self._piece(some, columns)

    def _piece(self, rows: Sequence[Sequence[Any]], columns: dict[str, int]) -> Piece:
        piece: dict[str, NDArray[Any]] = {}
        for name, k in columns.items():
            cells = [row[k] for row in rows]
            if name in self.rounded and _NUMBERS.issuperset(map(type, cells)):
                piece[name] = np.array(cells, dtype=np.float64)
            else:
                piece[name] = text_cells([*map(self._text, cells)])
        return piece

    def place(self, row: int) -> str:
        """Return the line of a row."""
        rows = next(iter(self._tables.values())).rows(0)
        line = next((line for k, (line, _) in enumerate(rows) if k == row), row + 1)
        return f"{self.path}:{line}"


def _column(text: bytes, delimiter: str, k: int) -> NDArray[Any]:
    rows = (line.split(delimiter, k + 1) for line in text.decode("ascii").split("\n"))
    return text_cells([cells[k] if k < len(cells) else "" for cells in rows])


def _opened(raw: IO[bytes]) -> Any:
    """Return a text as UTF-8 to read by lines: unpacked, and UTF-16 turned."""
    raw.seek(0)
    packed = raw.read(2) == b"\x1f\x8b"
    raw.seek(0)
    file: Any = gzip.GzipFile(fileobj=raw) if packed else raw
    wide = file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    file.seek(0)
    return codecs.EncodedFile(file, "utf-8", "utf-16") if wide else file


def _raw_lines(path: Path) -> Iterator[bytes]:
    """Yield the lines of a file, unpacked; none is longer than the limit."""
    size = path.stat().st_size
    with path.open("rb") as raw:
        packed = raw.read(2) == b"\x1f\x8b"
        if packed and size > 8:
            raw.seek(-8, 2)
            # the check sum and the length of what is packed; zeros are searched through one by one
            if raw.read(8) == bytes(8):
                raise damaged(path, "gzip file", "it ends with zeros")
        file = _opened(raw)
        total, number = 0, 0
        limit = max(SMALL_BYTES, size * LIMIT_RATIO)
        while line := file.readline(_LONGEST_LINE):
            number += 1
            total += len(line)
            if b"\0" in line:
                what = "holds a NUL character; needed: plain text"
                raise data_error(path, number, what, "copy it again, or check what kind it is")
            if len(line) == _LONGEST_LINE:
                what = f"a line of more than {_LONGEST_LINE} bytes; needed: a table of text"
                raise data_error(path, number, what, "check that this is the right file")
            if packed and total > limit:
                raise DataError(
                    f"unpacks to more than {limit} bytes from {size}",
                    where=str(path),
                    fix="check that this is the right file, or unpack it by hand and split it",
                )
            yield line


def _decoded(raw: bytes) -> str:
    """Return a line as text; what is not UTF-8 is taken as the usual one of Windows."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("cp1252", "replace")


def _lines(path: Path, skip: int) -> Iterator[str]:
    """Yield the lines behind `skip` as text."""
    number = 0
    try:
        for number, raw in enumerate(_raw_lines(path), 1):
            if number == 1 and raw.startswith(b"\xef\xbb\xbf"):
                raw = raw[3:]
            if number > skip:
                yield _decoded(raw).replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeError as error:
        what = f"damaged UTF-16 text: {error}"
        raise data_error(path, number + 1, what, "save the file as UTF-8") from error
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise damaged(path, "gzip file", str(error)) from error


def open_file(path: Path, recipe: Recipe | None) -> CellsSource:
    """Open a table of text."""
    skip, mark, named, logger = 0, None, True, None
    if recipe is not None:
        skip, mark, logger = recipe.skip, recipe.mark, recipe.from_logger
        named = not recipe.no_header
    head = [*islice(_lines(path, skip), SEARCHED_LINES)]
    found = text_layout(head, mark, named=named)
    if found is None:
        raise DataError(
            "no data: no line of numbers" if any(map(str.strip, head)) else "no data",
            where=str(path),
            fix="check the file, --delimiter, or a smaller --skip",
        )
    if logger is not None and not any(map(is_time_or_date, found.names)):
        raise DataError(
            "no row of column names with a time and numbers below it",
            where=str(path),
            fix="say where the table begins: --skip LINES and --delimiter, without --from-logger; "
            "without names --no-header and --rate HZ",
        )
    begin = skip + found.start

    def rows(done: int) -> Iterator[tuple[int, list[str]]]:
        return _rows(path, begin + done, found)

    def plain() -> Iterator[tuple[list[FloatArray], bytes]]:
        return _plain(path, begin, found, decimal_comma=source.decimal_comma)

    source = CellsSource(path, "text", [CellTable(found, rows, plain=plain)])
    comma = ("decimal commas",) if source.decimal_comma else ()
    said = [i for i, line in enumerate(head[: found.start]) if is_comment(line)]
    told = sorted({*found.preamble, *said})
    stated = (head[i].strip() for i in told if head[i].strip())
    source.notes = (*stated, *comma, *source.notes, *_encoding(path))
    return source


def _encoding(path: Path) -> Iterator[str]:
    """Tell where the first lines of a text are not UTF-8."""
    with path.open("rb") as raw:
        file = _opened(raw)
        head = [file.readline(_LONGEST_LINE) for _ in range(SEARCHED_LINES)]
        if file is not raw and not isinstance(file, gzip.GzipFile):
            yield "UTF-16 text"
    for number, line in enumerate(head, 1):
        try:
            line.decode("utf-8")
        except UnicodeDecodeError:
            yield f"line {number} is not UTF-8: taken as Windows-1252"
            return


def _plain(
    path: Path, begin: int, layout: TableLayout, *, decimal_comma: bool
) -> Iterator[tuple[list[FloatArray], bytes]]:
    """Yield rows of numbers, each a line; end where there is anything else."""
    if layout.delimiter == " ":
        return
    names = [str(k) for k in range(layout.least)]
    head = (",".join(names) + "\n").encode()
    with path.open("rb") as raw:
        file = _opened(raw)
        try:
            for _ in range(begin):
                file.readline(_LONGEST_LINE)
            while chunk := file.read(_CHUNK_BYTES):
                chunk += file.readline(_LONGEST_LINE)
                lines = chunk.replace(b"\r\n", b"\n") if b"\r" in chunk else chunk
                lines = lines.removesuffix(b"\n")
                if decimal_comma and layout.delimiter != ",":
                    lines = lines.replace(b",", b".")
                plain = lines.replace(layout.delimiter.encode(), b",")
                found = parse_numbers(names, head + plain, len(head), path.stat().st_size)
                if found is None or any(np.isinf(column).any() for column in found.values()):
                    return
                columns = list(found.values())
                left_out = np.full(len(columns[0]), np.nan)
                yield [*columns, *[left_out] * (layout.width - layout.least)], lines
            yield [], b""
        except (EOFError, zlib.error, gzip.BadGzipFile, UnicodeError):
            return  # told by who reads row by row


def _rows(path: Path, begin: int, layout: TableLayout) -> Iterator[tuple[int, list[str]]]:
    width = layout.width
    line = begin + 1
    lines = ("" if is_comment(text) else text for text in _lines(path, begin))
    try:
        for number, row in split(lines, layout.delimiter):
            line = begin + number
            if not any(cell.strip() for cell in row):
                continue
            if len(row) > width and not any(cell.strip() for cell in row[width:]):
                row = row[:width]
            if not layout.least <= len(row) <= width:
                raise data_error(
                    path,
                    line,
                    f"{len(row)} cell{'s' * (len(row) > 1)}; needed: {width}",
                    "check --delimiter, take what stands below or beside the table out, or pass "
                    "lines before it over with --skip",
                )
            row += [""] * (width - len(row))
            yield line, row
    except csv.Error as error:
        raise data_error(path, line + 1, f"not a CSV row: {error}", "correct the row") from error
