"""Read and write trace CSV files (contract section 3)."""

from __future__ import annotations

import gzip
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from hdbench.errors import DataError
from hdbench.records import csvtext
from hdbench.records.parquetfile import PARQUET, parquet_columns
from hdbench.records.storage import write_atomic
from hdbench.records.trace import FloatArray, Trace

TRACE_COLUMNS = (
    "time_s",
    "motor_velocity_rad_s",
    "tacho_v",
    "motor_angle_rad",
    "encoder_count",
    "output_angle_rad",
    "torque_nm",
    "torque_v",
    "motor_current_a",
    "reference_v",
    "load_torque_nm",
    "temperature_c",
    "torque_filtered_online_nm",
)
_GROUPS = {
    "torque": ("torque_nm", "torque_v"),
    "velocity": ("motor_velocity_rad_s", "tacho_v"),
    "angle": ("motor_angle_rad", "encoder_count"),
}
_WRITE_FIX = "this trace cannot be stored; make it again"
# rows written at a time: bounds the memory that their text takes on the way
_CHUNK_ROWS = 50_000
# a larger file is read by pieces of this size, for its text takes more than its numbers
_PIECE_BYTES = 16 << 20


def read_trace(path: Path, *, require: Sequence[str] = ("torque", "velocity")) -> Trace:
    """Read a trace.

    Parameters
    ----------
    path : Path
        A ``.csv``, ``.csv.gz`` or ``.parquet`` file; of the last, rows count as lines.
    require : sequence of str
        What must be there beside ``time_s``: ``torque`` (``torque_nm`` or ``torque_v``),
        ``velocity`` (``motor_velocity_rad_s`` or ``tacho_v``), ``angle`` (``motor_angle_rad`` or
        ``encoder_count``), or the name of a column.

    Returns
    -------
    Trace
        All numeric columns in file order. An empty cell or ``nan`` is a lost sample, NaN.
        Columns that the contract does not name and that hold text are in
        ``metadata["text_columns"]``.

    Raises
    ------
    DataError
        If the file is missing, too large or damaged; if a row, a cell or the order of the time
        is wrong (with line and column); if a required column is missing.
    """
    path = Path(path)
    texts: dict[str, tuple[str, ...]] = {}
    lines: Sequence[int]
    if path.suffix == PARQUET:
        columns, texts = parquet_columns(path)
        lines = range(1, 1 + len(next(iter(columns.values()), ())))
    else:
        found = _by_pieces(path)
        if found is None:
            raw = csvtext.read_raw(path, "trace")
            found = _fast(path, raw)
        if found is None:
            columns, texts, lines = _careful(csvtext.parse_table(path, csvtext.as_text(path, raw)))
        else:
            columns, lines = found, range(2, 2 + len(next(iter(found.values()))))
    _check_required(path, columns, texts, require)
    _check_values(path, columns, lines)
    return Trace(columns, str(path), {"text_columns": texts} if texts else {})


def _by_pieces(path: Path) -> dict[str, FloatArray] | None:
    """Parse a large well-formed file; None where it is small or needs the careful way."""
    if path.suffix != ".csv" or not path.is_file():
        return None
    parts: dict[str, list[FloatArray]] = {}
    # whoever reads the whole file says why it cannot
    with suppress(OSError), path.open("rb") as file:
        if not 2 * _PIECE_BYTES < path.stat().st_size <= csvtext.LIMIT_BYTES:
            return None
        head = file.readline(_PIECE_BYTES)
        while piece := file.read(_PIECE_BYTES):
            found = _fast(path, head + piece + file.readline(_PIECE_BYTES))
            if found is None:
                return None
            for name, values in found.items():
                parts.setdefault(name, []).append(values)
    return {name: np.concatenate(parts.pop(name)) for name in tuple(parts)} or None


def _fast(path: Path, raw: bytes) -> dict[str, FloatArray] | None:
    """Parse a well-formed file of numbers; None where it needs the careful way."""
    end = raw.find(b"\n")
    head = raw[:end] if end >= 0 else raw
    if b'"' in head or b"\r" in head or not head.isascii() or b"\0" in head:
        return None
    return csvtext.parse_numbers(
        csvtext.check_header(path, head.decode().split(",")), raw, len(head) + 1
    )


def _number(cell: str) -> float:
    word = cell.strip()
    if not word:
        return float("nan")
    if "_" in word or not word.isascii():
        raise ValueError(word)
    return float(word)


def _careful(
    table: csvtext.Table,
) -> tuple[dict[str, FloatArray], dict[str, tuple[str, ...]], Sequence[int]]:
    columns: dict[str, FloatArray] = {}
    texts: dict[str, tuple[str, ...]] = {}
    for index, name in enumerate(table.header):
        cells = [row[index] for row in table.rows]
        values = np.empty(len(cells))
        for row, cell in enumerate(cells):
            try:
                values[row] = _number(cell)
            except ValueError:
                if name in TRACE_COLUMNS:
                    raise _bad_cell(table.path, table.lines[row], name, cell) from None
                texts[name] = tuple(cells)
                break
        else:
            columns[name] = values
    return columns, texts, table.lines


def _bad_cell(path: Path, line: int, name: str, cell: str) -> DataError:
    fix = "correct the cell, or leave it empty where the sample was lost"
    if cell.strip().replace(",", ".", 1).lstrip("+-").replace(".", "", 1).isdigit():
        fix = csvtext.IMPORT_FIX
    return csvtext.data_error(
        path, line, f"column {name!r} holds {cell[:40]!r}; needed: a number, nan or nothing", fix
    )


def _check_required(
    path: Path,
    columns: dict[str, FloatArray],
    texts: dict[str, tuple[str, ...]],
    require: Sequence[str],
) -> None:
    for need in ("time_s", *require):
        names = _GROUPS.get(need, (need,))
        if not any(name in columns for name in names):
            there = ", ".join([*columns, *texts][:12])
            raise csvtext.data_error(
                path, 1, f"no column {' or '.join(names)}; found: {there}", csvtext.IMPORT_FIX
            )


def _check_values(path: Path, columns: dict[str, FloatArray], lines: Sequence[int]) -> None:
    for name, values in columns.items():
        if np.isinf(values).any():
            line = lines[int(np.argmax(np.isinf(values)))]
            what = f"column {name!r} is infinite; needed: a finite number, nan or nothing"
            fix = "leave the cell empty where the sample was lost"
            raise csvtext.data_error(path, line, what, fix)
    time_s = columns["time_s"]
    if np.isnan(time_s).any():
        line = lines[int(np.argmax(np.isnan(time_s)))]
        what = "column 'time_s' has no value; needed: a time in s on every row"
        raise csvtext.data_error(path, line, what, "give the row its time, or take the row out")
    wrong = ~(np.diff(time_s) > 0.0)
    if wrong.any():
        before = int(np.argmax(wrong))
        what = f"time_s {float(time_s[before + 1])!r} s after {float(time_s[before])!r} s"
        raise csvtext.data_error(
            path,
            lines[before + 1],
            f"{what}; needed: strictly increasing",
            "take out repeated rows, or sort by time",
        )


def write_trace(path: Path, trace: Trace) -> None:
    """Write a trace atomically; the same bits come back from `read_trace`.

    Parameters
    ----------
    path : Path
        A ``.csv`` or, packed, ``.csv.gz`` file to write or replace.
    trace : Trace
        The trace. Text columns of its metadata are written where they still have its length.

    Raises
    ------
    StorageError
        If the disk is full or failed; an old file is then untouched.
    DataError
        If there is no sample, a column has another length than the time or holds an infinity, or
        the time does not increase.
    """
    path, time_s = Path(path), trace.columns.get("time_s")
    if time_s is None or not len(time_s):
        raise DataError("a trace without samples", where=trace.source, fix=_WRITE_FIX)
    for name, values in trace.columns.items():
        if values.shape != time_s.shape:
            what = f"channel {name} has shape {values.shape}; needed: {time_s.shape}"
            raise DataError(what, where=trace.source, fix=_WRITE_FIX)
    kept = trace.metadata.get("text_columns", {})
    texts = {name: cells for name, cells in kept.items() if len(cells) == len(trace)}
    pieces = (
        [
            np.asarray(v, dtype=np.float64)[start : start + _CHUNK_ROWS]
            for v in trace.columns.values()
        ]
        for start in range(0, len(trace), _CHUNK_ROWS)
    )
    lines = trace_lines(tuple(trace.columns), pieces, trace.source, texts)
    if path.suffix == ".gz":
        lines = iter([gzip.compress(b"".join(lines), compresslevel=6, mtime=0)])
    write_atomic(path, lines)


def trace_lines(
    names: Sequence[str],
    pieces: Iterable[Sequence[FloatArray]],
    source: str,
    texts: Mapping[str, Sequence[str]] | None = None,
) -> Iterator[bytes]:
    """Yield a trace as text, its samples checked piece by piece; texts stand behind the numbers."""
    texts = texts or {}
    yield (",".join(map(csvtext.quoted, [*names, *texts])) + "\n").encode()
    row, last_s = 0, -np.inf
    for columns in pieces:
        for name, values in zip(names, columns, strict=True):
            infinite = np.flatnonzero(np.isinf(values))
            if len(infinite):
                what = f"channel {name} is infinite at sample {row + int(infinite[0])}"
                raise DataError(what, where=source, fix=_WRITE_FIX)
        time_s = columns[names.index("time_s")]
        if not (np.diff(time_s, prepend=last_s) > 0.0).all():
            what = "channel time_s does not increase strictly"
            raise DataError(what, where=source, fix=_WRITE_FIX)
        end, last_s = row + len(time_s), time_s[-1]
        yield _rows_as_bytes(columns, [cells[row:end] for cells in texts.values()])
        row = end


def _rows_as_bytes(columns: Iterable[FloatArray], texts: Iterable[Sequence[str]]) -> bytes:
    """Return rows as CSV; a number stands in its shortest form that reads back exactly."""
    cells = [list(map(repr, values.tolist())) for values in columns]
    cells += [list(map(csvtext.quoted, words)) for words in texts]
    return ("\n".join(map(",".join, zip(*cells, strict=True))) + "\n").encode()
