"""Bring other programs' logs into the contract's trace and loads files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.errors import StorageError, UsageError
from hdbench.importing.convert import Conversion, conversion
from hdbench.importing.derive import Derived
from hdbench.importing.loads import loads_lines
from hdbench.importing.mapping import ColumnMap, Constant, SourceColumn, find_source
from hdbench.importing.registry import open_source
from hdbench.importing.source import Asked, Source
from hdbench.importing.stated import own_time, since_1904, told_by_file
from hdbench.importing.text import ForeignFormat
from hdbench.importing.trace import Joined, Part, joined_trace
from hdbench.records.loads import LOADS_COLUMNS, LOADS_OPTIONAL
from hdbench.records.provenance import write_provenance
from hdbench.records.storage import publish, staged_path, write_atomic
from hdbench.records.tables import TRACE_COLUMNS, ArmLike, read_loads, read_trace, write_trace

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
    asked : Asked
        Topic and joint.
    side : str
        ``output`` where angles and velocities are those of the joint, else ``motor``.
    gear_ratio : float or None
        Gear ratio of the bench; needed for the side ``output``.
    derived : Derived
        Columns that are computed of others.
    """

    kind: str
    maps: tuple[ColumnMap, ...]
    constants: tuple[Constant, ...] = ()
    layout: ForeignFormat = field(default_factory=ForeignFormat)
    rate_hz: float | None = None
    keep_time: bool = False
    asked: Asked = field(default_factory=Asked)
    side: str = "motor"
    gear_ratio: float | None = None
    derived: Derived = field(default_factory=Derived)


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
    done : dict of str to list of str
        What was done for each column, step by step.
    """

    out: Path
    kind: str
    rows: int
    columns: tuple[str, ...]
    time_origin_s: float | None
    lost: int
    notes: tuple[str, ...]
    done: dict[str, list[str]] = field(default_factory=dict)

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
            "done": self.done,
        }


def known_columns(kind: str) -> tuple[str, ...]:
    """Return the column names of the contract for one kind of file."""
    return _COLUMNS[kind]


def _sources(plan: ImportPlan, source: Source, number: int) -> dict[str, str]:
    """Return the channel of each column; a map for this file goes before one for all."""
    taken = {c.target for c in plan.constants if c.file in (None, number)}
    known = [c.name for c in source.channels if c.name in _COLUMNS[plan.kind]]
    found = {name: name for name in known if name not in taken}
    if plan.rate_hz is not None:
        found.pop("time_s", None)
    for wanted in (None, number):
        found.update({m.target: m.source for m in plan.maps if m.file == wanted})
    both = sorted(taken & set(found))
    if both:
        raise UsageError(
            f"column {both[0]!r} of file {number} is both mapped and set",
            where="--map, --set",
            fix="give one of them",
        )
    return found


def _conversions(
    plan: ImportPlan, source: Source, number: int
) -> tuple[dict[str, Conversion], list[str]]:
    """Return what turns the channels of one file into ours, and what a person should know."""
    found = _sources(plan, source, number)
    logged = plan.layout.logger is not None

    def turned(target: str, column: SourceColumn, given: str) -> Conversion:
        # a time of another clock, or one that no map names, is turned by what the file says
        turn = logged or target.startswith("time_s of ")
        return conversion(
            target.partition(" ")[0],
            source,
            column,
            turn=turn,
            side=plan.side,
            ratio=plan.gear_ratio,
            given=given,
        )

    result = {
        target: turned(target, find_source(source, text, _option(target)), text)
        for target, text in found.items()
    }
    notes = told_by_file(source)
    if plan.kind == "trace" and plan.rate_hz is None:
        named = result.get("time_s")
        clocks = {c.column.channel.clock for t, c in result.items() if t != "time_s"}
        for clock in sorted(clocks - ({named.column.channel.clock} if named else set())):
            time = own_time(source, clock)
            if time is not None:
                name = f"time_s of {clock}"
                result[name] = turned(name, SourceColumn(time), time.name)
                notes.append(f"{source.path}: time from {time.name}")
    for target, done in result.items():
        if logged and done.factor != 1:
            channel, ours = done.column.channel, target.partition(" ")[0]
            told = f"{channel.name} from {channel.unit} times {done.factor:.6g}"
            notes.append(f"{source.path}: {told} is {ours}")
        if logged and target.startswith("time_s"):
            notes += since_1904(source, done.column.channel.name)
    return result, notes


def _option(target: str) -> str:
    return "--time" if target == "time_s" else "--map"


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


def import_files(
    plan: ImportPlan, files: Sequence[Path], out: Path, arm: ArmLike | None = None
) -> ImportReport:
    """Bring foreign logs into one trace or loads file, and read it back."""
    _check(plan, files, out)
    with ExitStack() as stack:
        parts: list[Part] = []
        notes: list[str] = []
        for number, file in enumerate(files, 1):
            source = stack.enter_context(closing(open_source(file, plan.layout, plan.asked)))
            found, told = _conversions(plan, source, number)
            parts.append(Part(source, found, _constants(plan, number)))
            notes += told
        forms = [(part.source.path, part.source.form) for part in parts]
        staged = staged_path(out)
        try:
            if plan.kind == "loads":
                report = _loads(parts, staged, out, notes, arm)
            else:
                joined = joined_trace(
                    parts, plan.derived, rate_hz=plan.rate_hz, keep_time=plan.keep_time
                )
                report = _trace(joined, staged, out, notes)
            described = {
                "columns": report.done,
                "notes": list(report.notes),
                "time_origin_s": report.time_origin_s,
            }
            publish(staged, out)
            write_provenance(out, forms, described)
        except StorageError as error:
            # the file beside it is ours; a person knows the one that was to be made
            raise StorageError(error.what, where=str(out), fix=error.fix) from error
        finally:
            staged.unlink(missing_ok=True)
    return report


def _loads(
    parts: Sequence[Part], staged: Path, out: Path, notes: list[str], arm: ArmLike | None
) -> ImportReport:
    names, content = loads_lines(parts)
    write_atomic(staged, content)
    rows = len(read_loads(staged, arm))
    done = {name: c.told() for name, c in parts[0].conversions.items()}
    return ImportReport(out, "loads", rows, names, None, 0, tuple(notes), done)


def _trace(joined: Joined, staged: Path, out: Path, notes: list[str]) -> ImportReport:
    write_trace(staged, joined.trace)
    back = read_trace(staged, require=("torque",))
    lost = sum(int(np.isnan(column).sum()) for column in back.columns.values())
    told = [*notes, *joined.notes]
    if not {"motor_velocity_rad_s", "tacho_v"} & set(back.columns):
        told.append("no velocity: filter, ripple, misalignment and diagnose need one")
    origin = None if joined.origin is None else float(joined.origin)
    names = tuple(back.columns)
    return ImportReport(out, "trace", len(back), names, origin, lost, tuple(told), joined.done)
