"""ASAM MDF 4 (and 3) measurement files, by asammdf (LGPL).

Each group of channels keeps its own time; groups are never merged.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hdbench.importing.source import (
    Channel,
    Piece,
    Source,
    closed_on_error,
    damaged,
    numbers,
    piece_rows,
    spans,
    spelled,
    text_cells,
)

_FORM = "MDF file"
_MOST_RECORD_BYTES = 1 << 16


class _MdfSource(Source):
    def __init__(self, path: Path, file: Any) -> None:
        super().__init__(path, _FORM, file.close)
        self._file = file
        made: list[tuple[Channel, tuple[int, int, bool]]] = []
        notes: list[str] = []
        size = path.stat().st_size
        # links of a damaged file may claim any number
        for number, group in enumerate(file.groups):
            rows = int(group.channel_group.cycles_nr)
            record = int(getattr(group.channel_group, "samples_byte_nr", 0))
            if not rows or record > _MOST_RECORD_BYTES:
                continue
            # deflate cannot pass 1032
            if rows * max(record, 1) > 1100 * size:
                raise damaged(path, _FORM, f"group {number + 1} claims {rows} records")
            master = file.masters_db.get(number)
            source = str(getattr(group.channel_group, "acq_name", "") or f"group{number + 1}")
            for index, channel in enumerate(group.channels):
                conversion = getattr(channel, "conversion", None)
                timed = index == master
                unit = getattr(channel, "unit", "") or getattr(conversion, "unit", "")
                name = f"{source}/{channel.name}"
                # the library would hand a formula of the file to an evaluator of Python
                if getattr(conversion, "formula", ""):
                    notes.append(f"{spelled(name)} has a formula, which is not run: left out")
                    continue
                # by a table its numbers are words: the numbers themselves are taken
                coded = bool(getattr(conversion, "referenced_blocks", None))
                unit = str(unit or ("s" if timed else ""))
                made.append((Channel(name, unit, str(number), timed, rows), (number, index, coded)))
        self._places = self.hold(made)
        self.notes = tuple(notes)

    def pieces(self, names: Sequence[str]) -> Iterator[Piece]:
        rows = next(c.rows for c in self.channels if c.name == names[0]) or 0
        for start, count in spans(rows, piece_rows(len(names))):
            piece = {name: self._read(name, start, count) for name in names}
            if any(len(values) != count for values in piece.values()):
                raise damaged(self.path, _FORM, f"a group ends before its {rows} records")
            yield piece

    def _read(self, name: str, start: int, count: int) -> Any:
        number, index, coded = self._places[name]
        samples, invalid = self._file.get(
            group=number,
            index=index,
            record_offset=start,
            record_count=count,
            ignore_invalidation_bits=False,
            samples_only=True,
            raw=coded,
        )
        values = np.asarray(samples)
        found = numbers(values) if values.ndim == 1 else None
        if found is None:
            return text_cells(["nan"] * len(values))
        if invalid is not None and np.any(invalid):
            found = np.where(np.asarray(invalid), np.nan, found)
        return found


def open_file(path: Path) -> Source:
    """Open an MDF file."""
    asammdf: Any = importlib.import_module("asammdf")
    if path.stat().st_size < 64 + 104:
        raise damaged(path, _FORM, f"{path.stat().st_size} bytes, less than its header")
    # by its path the library would read a channel whole for each piece of it
    file = asammdf.MDF(path.open("rb"))
    with closed_on_error(file.close):
        return _MdfSource(path, file)
