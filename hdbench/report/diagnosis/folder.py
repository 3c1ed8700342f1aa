"""Tables in the folder of a diagnosis, read for figures and for the screen."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hdbench.records import FloatArray
from hdbench.records.csvtext import parse_table, read_text

Columns = Mapping[str, FloatArray]


def read_columns(path: Path) -> Columns | None:
    """Read a table of numbers, NaN where a cell has none; None where there is no such file."""
    if not path.is_file():
        return None
    table = parse_table(path, read_text(path, "table"))
    columns = zip(*table.rows, strict=True)
    return {
        name: np.array([_number(cell) for cell in cells])
        for name, cells in zip(table.header, columns, strict=True)
    }


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")
