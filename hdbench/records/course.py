"""The course of a calibration as a file: everything that was done, in order, and what counts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hdbench.records.attempts import reading_entries
from hdbench.records.journal import JournalContent
from hdbench.records.storage import write_atomic
from hdbench.records.table import quoted

__all__ = ["COURSE_NAME", "write_course"]

COURSE_NAME = "sequence.csv"
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


def write_course(folder: Path, content: JournalContent) -> Path:
    """Write ``sequence.csv``: readings, preloads, checks and mountings, in order of time."""
    superseded = iter(reading_entries(content))
    lines = [",".join(_COLUMNS)]
    for block in content.blocks:
        body = block.extra
        if block.kind == "reading":
            kind = "zero" if body.get("mass_kg") == 0.0 else "reading"
            lines.append(_line(kind, body, next(superseded).superseded or ""))
        elif body.get("event") == "prepared":
            lines.append(_line(_KINDS.get(str(body.get("role")), "reading"), body, ""))
        elif body.get("event") == "rejected":
            lines.append(_line("reading", body, "rejected"))
        elif body.get("event") == "placed":
            lines.append(_line("remounted", body, ""))
    path = folder / COURSE_NAME
    write_atomic(path, ("\n".join(lines) + "\n").encode())
    return path


def _line(kind: str, body: Mapping[str, Any], superseded: str) -> str:
    cells = {**body, "kind": kind, "superseded": superseded}
    return ",".join(_cell(cells.get(name)) for name in _COLUMNS)


def _cell(value: object) -> str:
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else quoted(str(value))
