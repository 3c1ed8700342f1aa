"""Samples and readings of a journal: which of them count, as trace, loads and sequence.

Blocks of kind ``event`` hold ``event`` in their `extra`. Three of them decide what counts:
``acquisition`` (``step``, ``attempt``): the samples behind it belong to that step, in place of
those of an earlier attempt; ``acquired`` (``step``): the acquisition came to its end;
``reopened`` (``point``, ``why``): the reading of that point stays, but counts no more.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.errors import DataError
from hdbench.records.csvtext import csv_text
from hdbench.records.journal import JournalBlock, JournalContent, JournalReader
from hdbench.records.loads import SEQUENCE_NAME, LoadReading, Loads
from hdbench.records.storage import write_atomic
from hdbench.records.trace import FloatArray, Trace
from hdbench.records.tracefile import trace_lines


@dataclass(slots=True)
class SampleGroup:
    """One acquisition of a journal."""

    number: int  # its place in the journal, from 0
    step: int | None = None  # step of the plan; None where the journal names none
    attempt: int = 1  # which attempt of this step, from 1
    rows: int = 0  # samples, lost ones included
    complete: bool = False  # whether it came to its end
    superseded: bool = False  # True where a later attempt of the same step counts
    # channels, in the order in which they first came
    names: dict[str, None] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class JournalSamples:
    """Acquisitions of a journal; their samples are read when they are asked for."""

    source: Path | JournalContent  # the journal, or what was read of it
    groups: tuple[SampleGroup, ...]  # the acquisitions, in the order taken

    def __len__(self) -> int:
        return sum(group.rows for group in self.groups)

    def only(self, *groups: SampleGroup) -> JournalSamples:
        """Return the samples of these acquisitions alone."""
        return replace(self, groups=groups)

    @property
    def names(self) -> tuple[str, ...]:
        """Channels of the trace, in order."""
        return tuple(dict.fromkeys(name for group in self.groups for name in group.names))

    def blocks(self) -> Iterator[JournalBlock]:
        """Yield the blocks of samples, in order."""
        wanted = {group.number for group in self.groups}
        return (block for group, block in _grouped(self.source) if group.number in wanted)

    def trace(self, source: str) -> Trace:
        """Return the trace; memory is that of its channels."""
        columns: dict[str, FloatArray] = {name: np.full(len(self), np.nan) for name in self.names}
        row = 0
        for block in self.blocks():
            for name, values in block.columns.items():
                columns[name][row : row + block.rows] = values
            row += block.rows
        return Trace(columns, source)

    def write(self, path: Path) -> None:
        """Write the trace as `write_trace` does, with memory for one block."""
        where = str(self.source) if isinstance(self.source, Path) else "<memory>"
        if not len(self) or "time_s" not in self.names:
            raise DataError(
                "no samples in the journal", where=where, fix="run the experiment again"
            )
        write_atomic(path, trace_lines(self.names, self._pieces(), where))

    def _pieces(self) -> Iterator[list[FloatArray]]:
        """Yield the channels block by block."""
        names = self.names
        for block in self.blocks():
            lost = np.full(block.rows, np.nan)
            yield [block.columns.get(name, lost).astype(np.float64) for name in names]


def survey_samples(
    source: Path | JournalContent, counts: Callable[[SampleGroup], bool] | None = None
) -> JournalSamples:
    """Find out what samples a journal holds, and which of them count."""
    everything = all_samples(source)
    kept = [
        group
        for group in everything.groups
        if not group.superseded and (counts is None or counts(group))
    ]
    return everything.only(*kept)


def all_samples(source: Path | JournalContent) -> JournalSamples:
    """Find every acquisition of a journal that holds samples, superseded ones too."""
    groups: dict[int, SampleGroup] = {}
    for group, block in _grouped(source):
        groups[group.number] = group
        group.rows += block.rows
        group.names.update(dict.fromkeys(block.columns))
    last = {group.step: group for group in groups.values()}
    for group in groups.values():
        group.superseded = group.step is not None and last[group.step] is not group
    return JournalSamples(source, tuple(groups.values()))


def _grouped(source: Path | JournalContent) -> Iterator[tuple[SampleGroup, JournalBlock]]:
    """Yield blocks of samples with the acquisition that they belong to."""
    group = SampleGroup(0)
    for block in JournalReader(source) if isinstance(source, Path) else source.blocks:
        event = block.extra.get("event") if block.kind == "event" else None
        if event == "acquisition":
            step, attempt = block.extra.get("step"), int(block.extra.get("attempt", 1))
            group = SampleGroup(group.number + 1, step, attempt)
        elif event == "acquired":
            group.complete = True
        elif block.kind == "samples" and block.rows:
            yield group, block


@dataclass(frozen=True, slots=True)
class JournalSummary:
    """Counts of a journal."""

    # acknowledged samples and load readings
    samples: int = 0
    readings: int = 0
    torn_bytes: int = 0  # bytes of an unfinished last block, never acknowledged
    problem: str | None = None  # damage in the middle, as `JournalContent` tells it


def summarize_journal(path: Path) -> JournalSummary:
    """Count what a journal holds, one block in memory at a time."""
    reader = JournalReader(path)
    counted: Counter[str] = Counter()
    for block in reader:
        counted[block.kind] += 1 if block.kind == "reading" else block.rows
    return JournalSummary(counted["samples"], counted["reading"], reader.torn_bytes, reader.problem)


_COLUMNS = (
    "time_s",
    "kind",
    "experiment",
    "position_rad",
    "direction",
    "mass_kg",
    "torque_nm",
    "reading_v",
    "reading_std_v",
    "n_samples",
    "series",
    "point",
    "attempt",
    "superseded",
    "flags",
)
_KINDS = {"zero-check": "zero", "shunt": "shunt", "preload": "preload"}


@dataclass(frozen=True, slots=True)
class ReadingEntry:
    """One acknowledged reading."""

    entry: dict[str, Any]  # what its block holds: the fields of a `LoadReading` and others
    # why it counts no more, such as `repeat` or `back`; None while it counts
    superseded: str | None


def reading_entries(content: JournalContent) -> tuple[ReadingEntry, ...]:
    """Return every reading of a journal, in the order taken, and whether it counts."""
    found: list[ReadingEntry] = []
    standing: dict[object, int] = {}
    for block in content.blocks:
        point = block.extra.get("point")
        reason = None
        if block.kind == "reading":
            reason = "repeat"
        elif block.kind == "event" and block.extra.get("event") == "reopened":
            reason = str(block.extra.get("why", "repeat"))
        if reason is not None and point is not None and point in standing:
            index = standing.pop(point)
            found[index] = ReadingEntry(found[index].entry, reason)
        if block.kind == "reading":
            if point is not None:
                standing[point] = len(found)
            found.append(ReadingEntry(block.extra, None))
    return tuple(found)


def journal_loads(content: JournalContent, source: str) -> Loads:
    """Put the load readings of a journal together."""
    known = {f.name for f in dataclasses.fields(LoadReading)}
    found = reading_entries(content)
    entries = [reading.entry for reading in found if reading.superseded is None]
    if not entries:
        raise DataError("no readings in the journal", where=source, fix="run it again")
    try:
        readings = tuple(
            LoadReading(**{name: value for name, value in entry.items() if name in known})
            for entry in entries
        )
    except TypeError as error:
        raise DataError(
            f"a reading lacks a field: {error}", where=source, fix="run it again"
        ) from error
    others = dict.fromkeys(name for entry in entries for name in entry if name not in known)
    extra = {name: tuple(_text(entry.get(name)) for entry in entries) for name in others}
    return Loads(readings, source, {}, extra)


def _text(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return "" if value is None else str(value)


def write_sequence(folder: Path, content: JournalContent) -> Path:
    """Write ``sequence.csv``: readings, preloads, checks and mountings, in order of time."""
    superseded = iter(reading_entries(content))
    rows: list[list[Any]] = []

    def add(kind: str, entry: Mapping[str, Any], superseded: str = "") -> None:
        cells = {**entry, "kind": kind, "superseded": superseded}
        rows.append([cells.get(name) for name in _COLUMNS])

    for block in content.blocks:
        entry = block.extra
        if block.kind == "reading":
            kind = "zero" if entry.get("mass_kg") == 0.0 else "reading"
            add(kind, entry, next(superseded).superseded or "")
        elif entry.get("event") == "prepared":
            add(_KINDS.get(str(entry.get("role")), "reading"), entry)
        elif entry.get("event") == "rejected":
            add("reading", entry, "rejected")
        elif entry.get("event") == "placed":
            add("remounted", entry)
    path = folder / SEQUENCE_NAME
    write_atomic(path, csv_text(_COLUMNS, rows).encode())
    return path
