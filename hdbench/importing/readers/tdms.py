"""National Instruments TDMS files, by npTDMS (LGPL), by pieces and without the data in memory."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.importing import source
from hdbench.importing.units import is_time_name, stated_unit

_FORM = "TDMS file"
_TIME = "time"
# channels of no more than that are read at once
_WHOLE_BYTES = 128 << 20


class _TdmsSource(source.Source):
    def __init__(self, path: Path, file: Any) -> None:
        super().__init__(path, _FORM, file.close)
        self._file = file
        made: list[tuple[source.Channel, Any]] = []
        size = path.stat().st_size
        starts = [c.properties.get("wf_start_time") for g in file.groups() for c in g.channels()]
        begin = min((s for s in starts if isinstance(s, np.datetime64)), default=None)
        for group in file.groups():
            clocks: dict[str, tuple[float, float, int]] = {}
            for channel in group.channels():
                rows = len(channel)
                # a sample takes a byte at least, whatever the header claims
                if rows > 8 * size:
                    raise source.damaged(path, _FORM, f"{channel.path} claims {rows} samples")
                if not rows or channel.dtype.kind not in "fbiumM":
                    continue
                properties = channel.properties
                step = source.finite_or_nan(properties.get("wf_increment", 0.0))
                start = source.finite_or_nan(properties.get("wf_start_offset", 0.0))
                start += _seconds_since(properties.get("wf_start_time"), begin)
                clock = f"{group.name}:{rows}"
                if step > 0.0 and np.isfinite(start):
                    clock += f":{step:.12g}:{start:.12g}"
                    clocks[clock] = (start, step, rows)
                unit = str(properties.get("unit_string") or stated_unit(channel.name))
                unit = "ns" if channel.dtype.kind in "mM" else unit
                timed = is_time_name(channel.name)
                name = f"{group.name}/{channel.name}"
                made.append((source.Channel(name, unit, clock, timed, rows), channel))
            for clock, (start, step, rows) in clocks.items():
                told = f"{group.name}/{_TIME}"
                made.append((source.Channel(told, "s", clock, True, rows), (start, step)))
        self._data = self.hold(made)
        self.notes = tuple(
            f"{source.spelled(str(k))} = {source.spelled(str(v))[:60]}"
            for k, v in file.properties.items()
        )

    def pieces(self, names: Sequence[str]) -> Iterator[source.Piece]:
        rows = next(c.rows for c in self.channels if c.name == names[0]) or 0
        # the library reads what was written at once whole, whatever part of it is asked for
        most = rows if 8 * rows * len(names) <= _WHOLE_BYTES else source.piece_rows(len(names))
        for first, many in source.spans(rows, most):
            read = {name: self._read(name, first, many) for name in names}
            for start, count in source.spans(many, source.piece_rows(len(names))):
                yield {name: values[start : start + count] for name, values in read.items()}

    def _read(self, name: str, start: int, count: int) -> NDArray[Any]:
        what = self._data[name]
        if isinstance(what, tuple):
            return np.asarray(what[0] + what[1] * np.arange(start, start + count))
        found = source.numbers(np.asarray(what.read_data(start, count)))
        if found is None or len(found) != count:
            raise source.damaged(self.path, _FORM, f"{name} ends before its samples do")
        return found


def _seconds_since(start: object, begin: np.datetime64 | None) -> float:
    """Return the start of a waveform after the first one of the file, s."""
    if begin is None or not isinstance(start, np.datetime64) or np.isnat(start):
        return 0.0
    return float((start - begin) / np.timedelta64(1, "s"))


def open_file(path: Path) -> source.Source:
    """Open a TDMS file."""
    nptdms: Any = importlib.import_module("nptdms")
    file = nptdms.TdmsFile.open(path, raw_timestamps=False)
    with source.closed_on_error(file.close):
        if file.file_status.incomplete_final_segment:
            raise source.damaged(path, _FORM, "its last segment is cut off")
        return _TdmsSource(path, file)
