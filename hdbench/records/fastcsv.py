"""Well-formed CSV of numbers, fast: by polars where it is installed, else by Python's own float.

Both ways round a decimal number to the nearest float64. Whatever is not plain (quotes, text, a row
of another length, a number that one of them does not know) is left to the careful reader, which
names line and column.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Sequence

import numpy as np

from hdbench.records.trace import FloatArray

__all__ = ["parse_numbers"]

# rows converted at a time: bounds the memory that Python floats take on the way
_CHUNK_ROWS = 50_000
# characters from where on polars pays: importing it takes as long as reading this much without
_WORTH_IMPORTING = 10_000_000


def parse_numbers(header: Sequence[str], body: str) -> dict[str, FloatArray] | None:
    """Parse rows of numbers."""
    if "_" in body or not body or body.startswith("\n"):
        return None
    if len(body) >= _WORTH_IMPORTING and importlib.util.find_spec("polars") is not None:
        return _by_polars(header, body)
    return _by_float(header, body)


def _by_polars(header: Sequence[str], body: str) -> dict[str, FloatArray] | None:
    polars = importlib.import_module("polars")
    rows = body.count("\n") + (not body.endswith("\n"))
    # polars fills short rows up and refuses long ones: with this many commas there is neither
    if body.count(",") != rows * (len(header) - 1) or len(header) < 2:
        return None
    try:
        frame = polars.read_csv(
            body.encode(),
            has_header=False,
            quote_char=None,
            schema=dict.fromkeys(header, polars.Float64),
        )
    except polars.exceptions.PolarsError:
        return None
    if frame.height != rows or any(frame.null_count().row(0)):
        return None  # a null may be an empty cell or more: the careful way tells
    return {name: np.array(frame[name], dtype=np.float64) for name in header}


def _by_float(header: Sequence[str], body: str) -> dict[str, FloatArray] | None:
    lines = body.rstrip("\n").split("\n")
    commas = len(header) - 1
    if any(line.count(",") != commas for line in lines) or not lines[0]:
        return None
    values = np.empty((len(lines), len(header)))
    try:
        for start in range(0, len(lines), _CHUNK_ROWS):
            cells = ",".join(lines[start : start + _CHUNK_ROWS]).split(",")
            part = np.array(list(map(float, cells)))
            values[start : start + _CHUNK_ROWS] = part.reshape(-1, len(header))
    except ValueError:
        return None
    return {name: np.ascontiguousarray(values[:, i]) for i, name in enumerate(header)}
