"""Parquet files, by pyarrow, in batches of rows."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.errors import DataError
from hdbench.importing.source import Channel, Piece, Source, numbers, piece_rows, text_cells
from hdbench.importing.units import is_time_name, stated_unit

_FORM = "Parquet file"
# a group of rows is unpacked by columns; writers make groups of some MB
_MOST_GROUP_BYTES = 1 << 30


class _ParquetSource(Source):
    row_word = "row"

    def __init__(self, path: Path, file: Any) -> None:
        super().__init__(path, _FORM, file.close)
        self._file = file
        meta = file.metadata
        for k in range(meta.num_row_groups):
            size = meta.row_group(k).total_byte_size
            if not 0 <= size <= _MOST_GROUP_BYTES:
                raise DataError(
                    f"row group {k + 1} of {size} bytes; needed: at most {_MOST_GROUP_BYTES}",
                    where=str(path),
                    fix="write it again with smaller row groups",
                )
        made: list[tuple[Channel, int]] = []
        for k, column in enumerate(file.schema_arrow):
            if not _is_plain(str(column.type)):
                continue
            unit = _unit(column)
            timed = is_time_name(column.name) and "string" not in str(column.type)
            made.append((Channel(column.name, unit, "", timed, meta.num_rows), k))
        self._columns = self.hold(made)

    def pieces(self, names: Sequence[str]) -> Iterator[Piece]:
        schema = self._file.schema_arrow.names
        wanted = {name: schema[self._columns[name]] for name in names}
        if len(set(schema)) != len(schema):
            raise DataError(
                "a column name occurs twice", where=str(self.path), fix="write it again"
            )
        batches = self._file.iter_batches(piece_rows(len(names)), columns=list(wanted.values()))
        for batch in batches:
            yield {name: _array(batch.column(column)) for name, column in wanted.items()}


def _is_plain(kind: str) -> bool:
    starts = ("int", "uint", "float", "double", "half", "bool", "timestamp", "duration", "string")
    return kind.startswith((*starts, "large_string", "decimal"))


def _unit(column: Any) -> str:
    told = {k.decode("utf-8", "replace").lower(): v for k, v in (column.metadata or {}).items()}
    for key in ("unit", "units"):
        if key in told:
            return str(told[key].decode("utf-8", "replace"))
    if str(column.type).startswith(("timestamp", "duration")):
        return "ns"
    return stated_unit(column.name)


def _array(column: Any) -> Any:
    kind = str(column.type)
    if "string" in kind:
        return text_cells(["" if cell is None else cell for cell in column.to_pylist()])
    if kind.startswith(("decimal", "bool")):
        return np.array([np.nan if c is None else float(c) for c in column.to_pylist()])
    found = numbers(column.to_numpy(zero_copy_only=False))
    return np.full(len(column), np.nan) if found is None else found


def open_file(path: Path) -> Source:
    """Open a Parquet file."""
    library: Any = importlib.import_module("pyarrow.parquet")
    # a pre-buffered file is read ahead by whole groups of rows
    return _ParquetSource(path, library.ParquetFile(path, pre_buffer=False))
