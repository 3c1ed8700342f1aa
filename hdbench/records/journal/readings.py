"""Readings of a journal: which of them count, as loads and as the sequence of a calibration.

A block of kind ``event`` with ``event`` = ``reopened`` (``point``, ``why``) in its `extra` says
that the reading of that point stays, but counts no more.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.records.journal.file import JournalContent
from hdbench.records.loads import LoadReading, Loads
from hdbench.records.storage import write_atomic
from hdbench.records.tables.csvtext import quoted
from hdbench.records.tables.loadsfile import SEQUENCE_NAME

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
    """One acknowledged reading.

    Parameters
    ----------
    entry : dict
        What its block holds: the fields of a `LoadReading` and others.
    superseded : str or None
        Why it counts no more, such as ``repeat`` or ``back``; None while it counts.
    """

    entry: dict[str, Any]
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
    lines = [",".join(_COLUMNS)]
    for block in content.blocks:
        entry = block.extra
        if block.kind == "reading":
            kind = "zero" if entry.get("mass_kg") == 0.0 else "reading"
            lines.append(_line(kind, entry, next(superseded).superseded or ""))
        elif entry.get("event") == "prepared":
            lines.append(_line(_KINDS.get(str(entry.get("role")), "reading"), entry, ""))
        elif entry.get("event") == "rejected":
            lines.append(_line("reading", entry, "rejected"))
        elif entry.get("event") == "placed":
            lines.append(_line("remounted", entry, ""))
    path = folder / SEQUENCE_NAME
    write_atomic(path, ("\n".join(lines) + "\n").encode())
    return path


def _line(kind: str, entry: Mapping[str, Any], superseded: str) -> str:
    cells = {**entry, "kind": kind, "superseded": superseded}
    return ",".join(_cell(cells.get(name)) for name in _COLUMNS)


def _cell(value: object) -> str:
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else quoted(str(value))
