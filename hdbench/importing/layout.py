r"""Where the table begins in a text, what separates its columns, and what its cells hold.

One rule for all: the last rows of what was looked at say how wide the table is and which columns
hold numbers; it begins at the first row with numbers in all of those. Rows of names and units stand
directly above, anything else before them is a preamble, and comments may stand anywhere.

So LabJack's files come in (LJStreamM, LJStreamUD, LJLogM, LJLogUD: date, time, a line per channel,
``Time  v0 .. vN  y0 .. yN``, numbers, with tabs) and DATAQ's (quoted names, perhaps a line of units
below, with commas). The time of LabJack's logs counts from 1904-01-01 UTC (labjack.com,
"Understanding Timestamps in LJLogUD and LJLogM").
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from decimal import Decimal, InvalidOperation
from typing import Literal

from hdbench.importing.units import is_time_name, known_unit

MISSING = frozenset(("", "nan", "na", "n/a", "-nan", "nan(ind)", "-nan(ind)", "null", "none"))
_COMMA_NUMBER = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")
# the year first, or the day first with points between: no other order can be told for sure
_STAMP = re.compile(
    r"(?:(?:(?P<year>\d{4})[-/](?P<month>\d\d?)[-/](?P<day>\d\d?)"
    r"|(?P<day2>\d\d?)\.(?P<month2>\d\d?)\.(?P<year2>\d{4}))(?:T|\s+))?"
    r"(?P<hour>\d\d?):(?P<minute>\d\d):(?P<second>\d\d(?:[.,]\d{1,9})?)"
    r"\s*(?P<zone>Z|[+-]\d\d:?\d\d)?"
)
_EPOCH = date(1970, 1, 1).toordinal()
Logger = Literal["labjack", "dataq", "auto"]
# 1970-01-01 in seconds since 1904-01-01: 66 years, 17 of them leap years
EPOCH_1904_S = 2_082_844_800
# as many lines a file may have before its table: 96 channels with a line each, and some to spare
SEARCHED_LINES = 200
_DATE = re.compile(r"date\b.*", re.I)
_DAY = re.compile(r"\d+[./-]\d+[./-]\d+")
_COMMENTS = ("#", "%", "//")
# columns that hold a word now and then
_REMARK = re.compile(r"(?:comment|remark|note|bemerkung|kommentar|marker|event)s?", re.I)
# in this order where two fit as well: a comma may be a decimal one
_DELIMITERS = ("\t", ";", " ", ",")
# rows at the end of the lines looked at that say what the table is like
_TAIL = 5
_Row = tuple[int, list[str]]


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with a point or a comma."""
    word = cell.strip()
    if _COMMA_NUMBER.fullmatch(word):
        return True
    try:
        return word.isascii() and "_" not in word and Decimal(word).is_finite()
    except InvalidOperation:
        return False


def says_number(cell: str) -> bool:
    """Return whether a cell is a number, or a word that says that there is none."""
    return bool(cell.strip()) and (is_number(cell) or cell.strip().lower() in MISSING)


def stamp_seconds(cell: str) -> Decimal | None:
    """Return a stamp in s: since 1970 with a date, since midnight without; None for other text."""
    match = _STAMP.fullmatch(cell.strip())
    if match is None:
        return None
    days = 0
    if year := match["year"] or match["year2"]:
        month, day = match["month"] or match["month2"], match["day"] or match["day2"]
        try:
            days = date(int(year), int(month), int(day)).toordinal() - _EPOCH
        except ValueError:
            return None
    minutes = 60 * int(match["hour"]) + int(match["minute"])
    if match["zone"] not in (None, "Z"):
        sign, digits = match["zone"][0], match["zone"][1:].replace(":", "")
        minutes -= int(f"{sign}1") * (60 * int(digits[:2]) + int(digits[2:]))
    return 86400 * days + 60 * minutes + Decimal(match["second"].replace(",", "."))


def uses_decimal_comma(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether numbers are like 1,5 and none is like 1.5."""
    found = False
    for row in rows:
        for cell in row:
            word = cell.strip()
            if _COMMA_NUMBER.fullmatch(word):
                found = True
            elif "." in word and _COMMA_NUMBER.fullmatch(word.replace(".", ",", 1)):
                return False
    return found


@dataclass(frozen=True, slots=True)
class TableLayout:
    """Where a table is."""

    delimiter: str  # character between columns; a blank stands for any number of blanks
    start: int  # row of the first data among those looked at, from 0
    width: int  # number of columns
    least: int  # number of cells that a row has at least: a remark at its end may be left out
    # names, empty without a header, and units, empty text where none is stated
    names: tuple[str, ...]
    units: tuple[str, ...]
    preamble: tuple[int, ...]  # rows before the table that are no names


def is_time_or_date(name: str) -> bool:
    """Return whether a column is named as a time or a date."""
    return is_time_name(name) or _DATE.fullmatch(name.strip()) is not None


def is_comment(line: str) -> bool:
    """Return whether a line of text is a comment."""
    return line.lstrip().startswith(_COMMENTS)


def split(lines: Iterable[str], delimiter: str) -> Iterator[_Row]:
    """Split lines into cells, with the number of the line on which each row ends, from 1.

    Raises csv.Error where quotes do not match.
    """
    if delimiter == " ":
        yield from enumerate(map(str.split, lines), 1)
    else:
        reader = csv.reader(lines, delimiter=delimiter, strict=True)
        yield from ((reader.line_num, row) for row in reader)


def _split_line(line: str, delimiter: str) -> list[str]:
    return next(split([line], delimiter), (1, []))[1]


def _line_rows(lines: Sequence[str], delimiter: str) -> list[_Row]:
    rows = []
    for place, line in enumerate(lines):
        if line.strip() and not is_comment(line):
            try:
                cells = _split_line(line, delimiter)
            except csv.Error:
                continue
            if _filled(cells):
                rows.append((place, cells))
    return rows


def _filled(cells: Sequence[str]) -> int:
    return max((i for i, cell in enumerate(cells, 1) if cell.strip()), default=0)


def table_layout(
    rows: Sequence[_Row], delimiter: str, *, named: bool, comments: Sequence[_Row] = ()
) -> TableLayout | None:
    """Find the table among the first rows of a file; None where no row holds a number."""
    # LabVIEW ends what stands before a table by this line
    behind = 1 + max(
        (i for i, (_, cells) in enumerate(rows) if cells[:1] == ["***End_of_Header***"]), default=-1
    )
    tail = [cells for _, cells in rows[behind:][-_TAIL:]]
    widths = Counter(_filled(cells) for cells in tail if any(map(says_number, cells)))
    if not widths:
        return None
    width = max(widths, key=lambda w: (widths[w], w))

    def fits(cells: Sequence[str]) -> bool:
        return len(cells) >= width and _filled(cells) <= width

    fitting = [cells for cells in tail if fits(cells)]
    numeric = [k for k in range(width) if any(is_number(cells[k]) for cells in fitting)]

    def share(cells: Sequence[str]) -> float:
        return sum(says_number(cells[k]) for k in numeric) / len(numeric)

    def whole(cells: Sequence[str]) -> bool:
        told = any(map(says_number, cells))
        return told and all(says_number(cells[k]) or not cells[k].strip() for k in numeric)

    data = (i for i, (_, c) in enumerate(rows) if i >= behind and fits(c) and whole(c))
    start = next(data, None) if numeric else None
    if start is None:
        return None
    # a row with one bad cell is data too: who reads it names the cell
    while start > behind and len(rows[start - 1][1]) >= width and share(rows[start - 1][1]) >= 0.5:
        start -= 1
    # a column without any number ends the names, and perhaps the rows too
    above = [cells for _, cells in rows[behind:start]] if named else []
    names_row = next((cells for cells in reversed(above) if not _are_units(cells)), [])
    wide, least = _filled(names_row), width
    if wide > width and not any(map(is_number, names_row)):
        if all(len(cells) >= wide for cells in tail) and all(map(str.strip, names_row[:width])):
            width = least = wide
        elif all(_REMARK.fullmatch(name.strip()) for name in names_row[width:wide]):
            width = wide
    block = _header_block(rows[behind:], start - behind, width, comments) if named else []
    names, units = _names_and_units([cells for _, cells in block], width)
    before = [row for row in rows[:start] if row not in block]
    units = units or _units_before([cells for _, cells in before], names)
    told = tuple(place for place, _ in before)
    return TableLayout(delimiter, rows[start][0], width, least, names, units, told)


def _units_before(rows: Sequence[Sequence[str]], names: Sequence[str]) -> tuple[str, ...]:
    """Return the units that a row of the preamble has above its columns, as LabVIEW writes them."""
    units = [""] * len(names)
    for label, *cells in rows:
        words = [cell.strip() for cell in cells]
        if re.fullmatch(r"(?:\w+_)?units?(?:_\w+)?", label.strip(), re.I):
            below = len(units) - 1
            units[1:] = [
                word if known_unit(word) else "" for word in [*words, *[""] * below][:below]
            ]
        if label == "X_Dimension" and "Time" in words and names[:1] == ("X_Value",):
            units[0] = "s"
    return tuple(units) if any(units) else ()


def _header_block(
    rows: Sequence[_Row], start: int, width: int, comments: Sequence[_Row]
) -> list[_Row]:
    """Return the rows directly above the data that hold words and no number."""
    block: list[_Row] = []
    place = rows[start][0]
    for above, cells in reversed(rows[:start]):
        words = [cell for cell in cells if cell.strip()]
        # names may leave the last column out, as where rows end with a delimiter
        wide = len(cells) >= width or (not block and len(cells) == width - 1 > 1)
        # units may be left out behind the last one
        wide = wide or (not block and _are_units(cells))
        apart = place - above > 1 + (above + 1 in {c for c, _ in comments})
        # a title, or who it was, above names; groups of columns begin behind the first or are many
        titled = len(words) <= 2 < width - 1 and bool(cells[0].strip())
        titled = titled and any(not _are_units(below) for _, below in block)
        valued = any(is_number(word) or _DAY.match(word.strip()) for word in words)
        if (apart and block) or titled or valued or not wide or _filled(cells) > width:
            break
        block.insert(0, (above, cells))
        place = above
    if not block:
        block = [(c, cells) for c, cells in comments if c == place - 1 and len(cells) == width]
    return block


def _bare(cell: str) -> str:
    return cell.strip().strip("[]()").strip()


def _are_units(cells: Sequence[str]) -> bool:
    words = [_bare(cell) for cell in cells if cell.strip()]
    return bool(words) and 2 * sum(map(known_unit, words)) >= len(words)


def _names_and_units(
    block: Sequence[Sequence[str]], width: int
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    lines = [[cell.strip() for cell in [*cells, *[""] * width][:width]] for cells in block]
    units = [""] * width
    for index in range(len(lines) - 1, 0, -1):
        if _are_units(lines[index]):
            units = [_bare(cell) for cell in lines.pop(index)]
            break
    for line in lines[:-1]:  # a group has its name above its first column
        for k in range(1, width):
            line[k] = line[k] or line[k - 1]
    names = ["/".join(filter(None, parts)) for parts in zip(*lines, strict=True)]
    return tuple(names), tuple(units) if any(units) else ()


def text_layout(
    lines: Sequence[str], delimiter: str | None = None, *, named: bool = True
) -> TableLayout | None:
    """Find the table in the first lines of a text; None where no line holds a number."""
    best, most = None, 0
    for mark in (delimiter,) if delimiter else _DELIMITERS:
        rows = _line_rows(lines, mark)
        score = sum(is_number(cell) for _, cells in rows[-_TAIL:] for cell in cells)
        if score > most:
            stripped = [
                (i, line.lstrip().lstrip("#%/").strip())
                for i, line in enumerate(lines)
                if is_comment(line)
            ]
            comments = [(i, _split_line(text, mark)) for i, text in stripped if '"' not in text]
            best, most = table_layout(rows, mark, named=named, comments=comments), score
    return best
