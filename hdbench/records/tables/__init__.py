"""Tables of a run: trace and loads, as CSV or Parquet; errors name line and column."""

from __future__ import annotations

from hdbench.records.tables.csvtext import data_error, parse_table, quoted, read_text, safe_cell
from hdbench.records.tables.loadsfile import (
    ArmLike,
    is_loads_file,
    read_loads,
    read_sequence,
    write_loads,
)
from hdbench.records.tables.parquetfile import PARQUET, require_parquet
from hdbench.records.tables.tracefile import TRACE_COLUMNS, read_trace, write_trace

__all__ = [
    "PARQUET",
    "TRACE_COLUMNS",
    "ArmLike",
    "data_error",
    "is_loads_file",
    "parse_table",
    "quoted",
    "read_loads",
    "read_sequence",
    "read_text",
    "read_trace",
    "require_parquet",
    "safe_cell",
    "write_loads",
    "write_trace",
]
