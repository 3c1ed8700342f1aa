"""Import of other programs' logs into the contract's trace and loads files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.errors import DataError, StorageError, UsageError
from hdbench.importing.convert import (
    Conversion,
    SourceColumn,
    conversion,
    decimal_cell,
    find_source,
)
from hdbench.importing.layout import EPOCH_1904_S
from hdbench.importing.recipe import Entry, Recipe, known_columns
from hdbench.importing.registry import open_source
from hdbench.importing.source import Source
from hdbench.importing.trace import Part, write_joined
from hdbench.records.csvtext import csv_text
from hdbench.records.loads import LOADS_COLUMNS, ArmLike, read_loads
from hdbench.records.provenance import write_provenance
from hdbench.records.storage import publish, staged_path, write_atomic
from hdbench.records.tracefile import read_trace

# a device has at most some 100 channels with a line each; a person reads no more than these
_SHOWN_LINES, _SHOWN_CHARACTERS = 20, 120
_TEXT = ("experiment", "range", "direction", "series", "kind", "loading", "flags", "excluded_at_s")
_WHOLE = ("n_samples", "repeat", "mounting", "n_excluded")
_NEEDED = ("experiment", "position_rad", "range", "direction", "series", "reading_v")


@dataclass(frozen=True, slots=True)
class ImportReport:
    """What an import made; it was read back before this was made."""

    out: Path  # the new file
    kind: str  # `trace` or `loads`
    rows: int  # rows in it
    columns: tuple[str, ...]
    time_origin_s: float | None  # time that became 0, s
    lost: int  # cells of a trace without a number
    notes: tuple[str, ...]  # what a person should know
    # what was done for each column, step by step
    done: dict[str, list[str]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the report as ``--json`` prints it."""
        return {**asdict(self), "out": str(self.out)}


def _sources(
    recipe: Recipe, constants: Mapping[str, str], source: Source, number: int
) -> dict[str, str]:
    """Return the channel of each column; columns that bear a name of the contract come along."""
    known = [c.name for c in source.channels if c.name in known_columns(recipe.kind)]
    found = {name: name for name in known if name not in constants}
    if recipe.rate_hz is not None:
        found.pop("time_s", None)
    found |= _of_file(recipe.entries("map"), number)
    both = sorted(set(constants) & set(found))
    if both:
        raise UsageError(
            f"column {both[0]!r} of file {number} is both mapped and set",
            where="--map, --set",
            fix="give one of them",
        )
    return found


def _of_file(entries: Sequence[Entry], number: int) -> dict[str, str]:
    """Return what is for one file, by column; an entry for this file comes behind one for all."""
    return {e.target: e.text for wanted in (None, number) for e in entries if e.file == wanted}


def _conversions(
    recipe: Recipe, found: Mapping[str, str], source: Source, gear_ratio: float | None
) -> tuple[dict[str, Conversion], list[str]]:
    """Return what turns the channels of one file into ours, and what a person should know."""
    logged = recipe.from_logger is not None

    def turned(target: str, column: SourceColumn, given: str) -> Conversion:
        # a time of another clock, or one that no map names, is turned by what the file says
        turn = logged or target.startswith("time_s of ")
        return conversion(
            target.partition(" ")[0],
            source,
            column,
            turn=turn,
            side=recipe.side,
            ratio=gear_ratio,
            given=given,
        )

    result = {}
    for target, text in found.items():
        option = "--time" if target == "time_s" else "--map"
        result[target] = turned(target, find_source(source, text, option), text)
    notes = [f"{source.path}: {line[:_SHOWN_CHARACTERS]}" for line in source.notes[:_SHOWN_LINES]]
    if recipe.kind == "trace" and recipe.rate_hz is None:
        named = result.get("time_s")
        clocks = {c.column.channel.clock for t, c in result.items() if t != "time_s"}
        for clock in sorted(clocks - ({named.column.channel.clock} if named else set())):
            time = source.own_time(clock)
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
            notes += _since_1904(source, done.column.channel.name)
    return result, notes


def _since_1904(source: Source, time: str) -> list[str]:
    """Return when a log of LabJack began, where its time counts from 1904."""
    cell = next((str(piece[time][0]) for piece in source.read([time])), "")
    first = None if ":" in cell else decimal_cell(source, time, cell, 0)
    # seconds since 1904 of any day after 1970; no run counts 66 years from its own start
    if first is None or not EPOCH_1904_S < first < 2 * EPOCH_1904_S:
        return []
    start = datetime.fromtimestamp(float(first) - EPOCH_1904_S, UTC)
    return [f"{source.path}: time since 1904-01-01 UTC: {start:%Y-%m-%dT%H:%M:%SZ}"]


def _check(recipe: Recipe, files: Sequence[Path], out: Path) -> None:
    entries = [*recipe.entries("map"), *recipe.entries("set")]
    for entry in entries:
        if entry.file is not None and entry.file > len(files):
            raise UsageError(
                f"{entry.target!r} is for file {entry.file}; there are {len(files)} files",
                where="--map, --set",
                fix="count the files from 1 in the order of the command",
            )
    if recipe.rate_hz is not None and any(entry.target == "time_s" for entry in entries):
        what = f"a rate of {recipe.rate_hz} Hz beside a time column"
        raise UsageError(what, where="--rate", fix="give one of --time and --rate")
    if any(out.resolve() == Path(file).resolve() for file in files):
        raise UsageError(f"{out} is one of the inputs", where="--out", fix="name a new file")


def import_files(
    recipe: Recipe,
    files: Sequence[Path],
    out: Path,
    arm: ArmLike | None = None,
    gear_ratio: float | None = None,
) -> ImportReport:
    """Bring logs of other programs into one trace or loads file, and read it back."""
    _check(recipe, files, out)
    with ExitStack() as stack:
        parts: list[Part] = []
        notes: list[str] = []
        for number, file in enumerate(files, 1):
            source = stack.enter_context(closing(open_source(file, recipe)))
            constants = _of_file(recipe.entries("set"), number)
            named = _sources(recipe, constants, source, number)
            found, told = _conversions(recipe, named, source, gear_ratio)
            parts.append(Part(source, found, constants))
            notes += told
        forms = [(part.source.path, part.source.form) for part in parts]
        staged = staged_path(out)
        try:
            if recipe.kind == "loads":
                report = _loads(parts, staged, out, notes, arm)
            else:
                report = _trace(parts, recipe, staged, out, notes)
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
    names, content = _loads_lines(parts)
    write_atomic(staged, content)
    rows = len(read_loads(staged, arm))
    done = {name: c.told() for name, c in parts[0].conversions.items()}
    return ImportReport(out, "loads", rows, names, None, 0, tuple(notes), done)


def _trace(
    parts: Sequence[Part], recipe: Recipe, staged: Path, out: Path, notes: list[str]
) -> ImportReport:
    origin, done, told = write_joined(staged, parts, recipe)
    notes += told
    back = read_trace(staged, require=("torque",))
    lost = sum(int(np.isnan(column).sum()) for column in back.columns.values())
    if not {"motor_velocity_rad_s", "tacho_v"} & set(back.columns):
        notes.append("no velocity: filter, ripple, misalignment and diagnose need one")
    start = None if origin is None else float(origin)
    return ImportReport(
        out, "trace", len(back), tuple(back.columns), start, lost, tuple(notes), done
    )


def _cells(part: Part, name: str) -> list[str]:
    """Return a column of one file as the cells of a loads file."""
    if name in part.constants:
        return [part.constants[name]]
    conversion = part.conversions[name]
    channel = conversion.column.channel.name
    cells: list[str] = []
    for piece in part.source.read([channel]):
        raw = piece[channel]
        if name in _TEXT:
            cells += [str(cell).strip() for cell in raw.tolist()]
        else:
            values = conversion.piece(raw, len(cells))
            missing = np.flatnonzero(np.isnan(values))
            if len(missing) and name in (*_NEEDED, "torque_nm"):
                raise DataError(
                    f"no number for {name}; needed: one in every row",
                    where=part.source.place(len(cells) + int(missing[0])),
                    fix="fill the cell, or take the row out",
                )
            cells += [_number(name, value) for value in values.tolist()]
    return cells


def _number(name: str, value: float) -> str:
    if math.isnan(value):
        return ""
    return str(int(value)) if name in _WHOLE and value.is_integer() else repr(value)


def _names(parts: Sequence[Part]) -> list[str]:
    given = [set(part.conversions) | set(part.constants) for part in parts]
    everywhere, anywhere = set.intersection(*given), set.union(*given)
    for name in (*_NEEDED, *sorted(anywhere)):
        if name not in everywhere:
            number = next(i for i, names in enumerate(given, 1) if name not in names)
            raise UsageError(
                f"no column {name} for file {number}",
                where="--map, --set",
                fix=f"give --map {name}=COLUMN or --set {number}:{name}=VALUE",
            )
    if not {"torque_nm", "mass_kg"} & everywhere:
        raise UsageError(
            "no column torque_nm or mass_kg",
            where="--map",
            fix="give --map torque_nm=COLUMN, or --map mass_kg=COLUMN with the arm of --profile",
        )
    known = [name for name in LOADS_COLUMNS if name in everywhere]
    return known + sorted(everywhere - set(known))


def _loads_lines(parts: Sequence[Part]) -> tuple[tuple[str, ...], bytes]:
    """Join foreign readings into one loads file."""
    names = _names(parts)
    lines: list[tuple[str, ...]] = []
    for part in parts:
        columns = [_cells(part, name) for name in names]
        rows = max(map(len, columns))
        columns = [
            c * rows if n in part.constants else c for n, c in zip(names, columns, strict=True)
        ]
        if len({len(column) for column in columns}) > 1:
            raise DataError(
                "the columns have unlike numbers of rows; needed: the same for all",
                where=str(part.source.path),
                fix="map channels of one length and group",
            )
        lines += zip(*columns, strict=True)
    return tuple(names), csv_text(names, lines).encode()
