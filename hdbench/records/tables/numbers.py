"""Well-formed CSV of numbers, fast: by polars where it is installed, else by pydantic's parser.

Each way rounds a decimal number to the nearest float64, as Python does. What is not plain (quotes,
text, a row of another length) is left to the careful reader, which names line and column.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
from array import array
from collections.abc import Sequence

import numpy as np

from hdbench.records.trace import FloatArray

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
