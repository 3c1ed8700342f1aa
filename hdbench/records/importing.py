"""Bring other programs' logs into the contract's trace and loads files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any

from hdbench.errors import StorageError, UsageError
from hdbench.records.foreign import ForeignFormat, ForeignTable, read_foreign
from hdbench.records.importloads import loads_lines
from hdbench.records.importtrace import joined_trace
from hdbench.records.importunits import add_time, in_our_units, told_by_logger
from hdbench.records.loadsfile import LOADS_COLUMNS, LOADS_OPTIONAL, ArmLike, read_loads
from hdbench.records.mapping import ColumnMap, Constant
from hdbench.records.storage import publish, staged_path, write_atomic
from hdbench.records.tracefile import TRACE_COLUMNS, read_trace, write_trace

__all__ = ["ImportPlan", "ImportReport", "import_files", "known_columns"]

_COLUMNS = {"trace": TRACE_COLUMNS, "loads": (*LOADS_COLUMNS, *LOADS_OPTIONAL)}


@dataclass(frozen=True, slots=True)
class ImportPlan:
    """What comes from where.

    Parameters
    ----------
    kind : str
        ``trace`` or ``loads``.
    maps : tuple of ColumnMap
        Columns; those that already bear a name of the contract come along without one.
    constants : tuple of Constant
        Columns with one value.
    layout : ForeignFormat
        How the files are laid out.
    rate_hz : float or None
        Sample rate where there is no time column, Hz.
    keep_time : bool
        Keep the time as it is; else it starts at 0.
    """

    kind: str
    maps: tuple[ColumnMap, ...]
    constants: tuple[Constant, ...] = ()
    layout: ForeignFormat = field(default_factory=ForeignFormat)
    rate_hz: float | None = None
    keep_time: bool = False


@dataclass(frozen=True, slots=True)
class ImportReport:
    """What an import made; it was read back before this was made.

    Parameters
    ----------
    out : Path
        The new file.
    kind : str
        ``trace`` or ``loads``.
    rows : int
        Rows in it.
    columns : tuple of str
        Its columns.
    time_origin_s : float or None
        Time that became 0, s.
    lost : int
        Cells of a trace without a number.
    notes : tuple of str
        What a person should know.
    """

    out: Path
    kind: str
    rows: int
    columns: tuple[str, ...]
    time_origin_s: float | None
    lost: int
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the report as ``--json`` prints it."""
        return {
            "out": str(self.out),
            "kind": self.kind,
            "rows": self.rows,
            "columns": list(self.columns),
            "time_origin_s": self.time_origin_s,
            "lost": self.lost,
            "notes": list(self.notes),
        }


def known_columns(kind: str) -> tuple[str, ...]:
    """Return the column names of the contract for one kind of file.

    Parameters
    ----------
    kind : str
        ``trace`` or ``loads``.

    Returns
    -------
    tuple of str
    """
    return _COLUMNS[kind]


def _sources(plan: ImportPlan, table: ForeignTable, number: int) -> dict[str, str]:
    """Return the source of each column of one file; a map for this file goes before one for all."""
    taken = {c.target for c in plan.constants if c.file in (None, number)}
    sources = {n: n for n in table.header if n in _COLUMNS[plan.kind] and n not in taken}
    if plan.rate_hz is not None:
        sources.pop("time_s", None)
    for wanted in (None, number):
        sources.update({m.target: m.source for m in plan.maps if m.file == wanted})
    both = sorted(taken & set(sources))
    if both:
        raise UsageError(
            f"column {both[0]!r} of file {number} is both mapped and set",
            where="--map, --set",
            fix="give one of them",
        )
    return sources


def _constants(plan: ImportPlan, number: int) -> dict[str, str]:
    values: dict[str, str] = {}
    for wanted in (None, number):
        values.update({c.target: c.value for c in plan.constants if c.file == wanted})
    return values


def _check(plan: ImportPlan, files: Sequence[Path], out: Path) -> None:
    entries: list[ColumnMap | Constant] = [*plan.maps, *plan.constants]
    for entry in entries:
        if entry.file is not None and entry.file > len(files):
            raise UsageError(
                f"{entry.target!r} is for file {entry.file}; there are {len(files)} files",
                where="--map, --set",
                fix="count the files from 1 in the order of the command",
            )
    timed = any(entry.target == "time_s" for entry in entries)
    if plan.rate_hz is not None and (timed or not 0.0 < plan.rate_hz < math.inf):
        raise UsageError(
            f"a rate of {plan.rate_hz} Hz beside a time column" if timed else "no positive rate",
            where="--rate",
            fix="give --time or a positive --rate",
        )
    if any(out.resolve() == Path(file).resolve() for file in files):
        raise UsageError(f"{out} is one of the inputs", where="--out", fix="name a new file")


def _all_sources(
    plan: ImportPlan, tables: Sequence[ForeignTable]
) -> tuple[list[dict[str, str]], tuple[str, ...]]:
    """Return the sources of each file's columns, and what a person should know of them."""
    sources: list[dict[str, str]] = []
    notes: tuple[str, ...] = ()
    for number, table in enumerate(tables, 1):
        found = _sources(plan, table, number)
        logged = plan.layout.logger is not None
        if logged and plan.kind == "trace" and plan.rate_hz is None:
            add_time(table, found)
        turned, told = in_our_units(table, found, turn=logged)
        sources.append(turned)
        comma = (f"{table.path}: decimal commas",) if table.decimal_comma else ()
        notes += (*told_by_logger(table, found.get("time_s")), *comma, *told)
    return sources, notes


def import_files(
    plan: ImportPlan, files: Sequence[Path], out: Path, arm: ArmLike | None = None
) -> ImportReport:
    """Bring foreign logs into one trace or loads file, and read it back.

    Parameters
    ----------
    plan : ImportPlan
        What comes from where.
    files : sequence of Path
        The logs, at least one. Traces are joined in the order of their times.
    out : Path
        ``.csv`` or (traces) ``.csv.gz`` file to write or replace; replaced only when the new
        content was read back.
    arm : Arm or None
        Arm of the bench, for loads with masses.

    Returns
    -------
    ImportReport

    Raises
    ------
    UsageError
        If the plan does not fit the files.
    DataError
        If a file is damaged, a cell is no number, a time repeats or files overlap (with lines).
    StorageError
        If the disk is full or failed; an old file at `out` is then untouched.
    """
    _check(plan, files, out)
    tables = [read_foreign(Path(file), plan.layout) for file in files]
    sources, notes = _all_sources(plan, tables)
    constants = [_constants(plan, i) for i in range(1, len(tables) + 1)]
    staged = staged_path(out)
    try:
        if plan.kind == "loads":
            names, content = loads_lines(tables, sources, constants)
            write_atomic(staged, content)
            rows, origin, lost = len(read_loads(staged, arm)), None, 0
        else:
            trace, start = joined_trace(
                tables, sources, constants, rate_hz=plan.rate_hz, keep_time=plan.keep_time
            )
            write_trace(staged, trace)
            back = read_trace(staged, require=("torque",))
            names, rows, origin = tuple(back.columns), len(back), _origin(start)
            lost = sum(int(len(c) - back.valid(n).sum()) for n, c in back.columns.items())
            if not {"motor_velocity_rad_s", "tacho_v"} & set(names):
                notes += ("no velocity: filter, ripple, misalignment and diagnose need one",)
        publish(staged, out)
    except StorageError as error:
        # the file beside it is ours; a person knows the one that was to be made
        raise StorageError(error.what, where=str(out), fix=error.fix) from error
    finally:
        staged.unlink(missing_ok=True)
    return ImportReport(out, plan.kind, rows, names, origin, lost, notes)


def _origin(start: Decimal | None) -> float | None:
    return None if start is None else float(start)
