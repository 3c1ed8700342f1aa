"""The course of a calibration beside its readings: preloads, checks, mountings, in order."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from hdbench.records.table import parse_table
from hdbench.records.textfile import data_error, read_text

__all__ = ["SEQUENCE_NAME", "SequenceEntry", "read_sequence"]

SEQUENCE_NAME = "sequence.csv"


@dataclass(frozen=True, slots=True)
class SequenceEntry:
    """One thing that happened.

    Parameters
    ----------
    kind : str
        ``zero``, ``preload``, ``reading``, ``shunt`` or ``remounted``.
    experiment : str
        Loading experiment that it belongs to; empty where it belongs to none.
    superseded : str
        Why a reading counts no more; empty where it counts.
    time_s, torque_nm, reading_v : float or None
        Time since the start, s; applied torque, N m; reading, V. None where not told.
    """

    kind: str
    experiment: str
    superseded: str
    time_s: float | None
    torque_nm: float | None
    reading_v: float | None

    def to_dict(self) -> dict[str, object]:
        """Return the entry as results store it."""
        return {
            "kind": self.kind,
            "experiment": self.experiment,
            "superseded": self.superseded,
            "time_s": self.time_s,
            "torque_nm": self.torque_nm,
            "reading_v": self.reading_v,
        }


def read_sequence(path: Path) -> tuple[SequenceEntry, ...]:
    """Read the course of a calibration."""
    path = Path(path)
    if not path.is_file():
        return ()
    table = parse_table(path, read_text(path, "sequence file"))
    out = []
    for line, row in zip(table.lines, table.rows, strict=True):
        cells = dict(zip(table.header, row, strict=True))
        numbers = [
            _number(path, line, name, cells.get(name, ""))
            for name in ("time_s", "torque_nm", "reading_v")
        ]
        words = [cells.get(name, "").strip() for name in ("kind", "experiment", "superseded")]
        out.append(SequenceEntry(words[0], words[1], words[2], *numbers))
    return tuple(out)


def _number(path: Path, line: int, name: str, cell: str) -> float | None:
    text = cell.strip()
    if text.lower() in ("", "nan"):
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        what = f"column {name} holds {cell!r:.40}; needed: a finite number, or nothing"
        raise data_error(path, line, what, "correct the cell, or take the file away")
    return value
