"""Traces as Parquet files, read as the CSV ones are."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from hdbench.errors import DataError, UsageError
from hdbench.records.trace import FloatArray

PARQUET = ".parquet"
# as many cells as a CSV file of the largest size that is read could hold, ten bytes each
_LIMIT_CELLS = 100_000_000
_EXPORT_FIX = "export it again: hdbench export RUN --format parquet"


def library(name: str, extra: str, where: str, use: str) -> ModuleType:
    """Return a library that only some uses need, or name the extra that brings it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise UsageError(
            f"{name.partition('.')[0]} is not installed; needed {use}",
            where=where,
            fix=f"pip install 'hdbench[{extra}]'",
        ) from error


def require_parquet(where: str) -> ModuleType:
    """Return the library that reads and writes Parquet."""
    return library("pyarrow.parquet", "parquet", where, "for Parquet files")


def _opened(path: Path) -> Any:
    parquet = require_parquet(str(path))
    if not path.is_file():
        raise DataError("no such trace file", where=str(path), fix="check the path")
    try:
        return parquet.ParquetFile(path)
    except (OSError, ValueError) as error:
        raise DataError(f"no Parquet file: {error}", where=str(path), fix=_EXPORT_FIX) from error


def parquet_names(path: Path) -> tuple[str, ...]:
    """Return the column names of a Parquet file."""
    return tuple(_opened(path).schema_arrow.names)


def parquet_columns(path: Path) -> tuple[dict[str, FloatArray], dict[str, tuple[str, ...]]]:
    """Read the columns of a Parquet file."""
    file = _opened(path)
    names, rows = tuple(file.schema_arrow.names), file.metadata.num_rows
    if not 0 < rows * len(names) <= _LIMIT_CELLS:
        what = f"{rows} rows of {len(names)} columns; needed: 1 to {_LIMIT_CELLS} cells"
        raise DataError(what, where=str(path), fix="split the file, or record again")
    if len(set(names)) != len(names):
        raise DataError("a column name occurs twice", where=str(path), fix=_EXPORT_FIX)
    try:
        table = file.read()
    except (OSError, ValueError) as error:
        what = f"damaged Parquet file: {error}"
        raise DataError(what, where=str(path), fix="copy it again") from error
    columns: dict[str, FloatArray] = {}
    texts: dict[str, tuple[str, ...]] = {}
    for name in names:
        column = table.column(name)
        kind = str(column.type)
        if kind.startswith(("int", "uint", "float", "double", "halffloat", "bool", "null")):
            columns[name] = np.array(column.cast("float64", safe=False).to_numpy())
            continue
        cells = column.to_pylist()
        if any(isinstance(cell, str) for cell in cells):
            texts[name] = tuple("" if cell is None else str(cell) for cell in cells)
            continue
        try:
            columns[name] = np.array([np.nan if cell is None else float(cell) for cell in cells])
        except (TypeError, ValueError) as error:
            what = f"column {name!r} holds {str(error)[:80]}; needed: numbers"
            raise DataError(what, where=str(path), fix=_EXPORT_FIX) from error
    return columns, texts
