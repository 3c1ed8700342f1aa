"""The samples of a journal as a trace, without holding more of them than needed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hdbench.errors import DataError
from hdbench.records.journalreading import JournalBlock, iter_journal
from hdbench.records.storage import write_atomic
from hdbench.records.trace import FloatArray, Trace

__all__ = ["JournalSamples", "SampleCount", "survey_samples"]

# rows converted at a time: bounds the memory that Python floats take on the way
_CHUNK_ROWS = 20_000


@dataclass(slots=True)
class SampleCount:
    """One acquisition of a journal, counted.

    Parameters
    ----------
    step : int or None
        Step of the plan; None where the journal names none.
    attempt : int
        Which attempt of this step, from 1.
    rows : int
        Samples, lost ones included.
    complete : bool
        Whether it came to its end.
    names : dict of str to None
        Channels, in the order in which they first came.
    """

    step: int | None
    attempt: int
    rows: int = 0
    complete: bool = False
    names: dict[str, None] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class JournalSamples:
    """The acquisitions of a journal that count.

    Parameters
    ----------
    path : Path
        The journal.
    groups : tuple of SampleCount
        Every acquisition, in the order taken.
    kept : frozenset of int
        Which of them count, from 0.
    """

    path: Path
    groups: tuple[SampleCount, ...]
    kept: frozenset[int]

    def __len__(self) -> int:
        return sum(self.groups[number].rows for number in self.kept)

    @property
    def names(self) -> tuple[str, ...]:
        """Channels of the trace, in order."""
        found: dict[str, None] = {}
        for number in sorted(self.kept):
            found.update(self.groups[number].names)
        return tuple(found)

    def trace(self, source: str) -> Trace:
        """Return the trace; memory is that of its channels."""
        columns: dict[str, FloatArray] = {name: np.full(len(self), np.nan) for name in self.names}
        row = 0
        for block in self._blocks():
            n = _rows(block)
            for name, values in block.columns.items():
                columns[name][row : row + n] = values
            row += n
        return Trace(columns, source)

    def write(self, path: Path) -> None:
        """Write the trace as `write_trace` does, with memory for a few thousand rows."""
        if not len(self) or "time_s" not in self.names:
            raise DataError(
                "no samples in the journal", where=str(self.path), fix="run the experiment again"
            )
        write_atomic(path, self._lines())

    def _blocks(self) -> Iterator[JournalBlock]:
        for number, block in _numbered(self.path):
            if number in self.kept:
                yield block

    def _lines(self) -> Iterator[bytes]:
        names = self.names
        yield (",".join(names) + "\n").encode()
        waiting: list[Mapping[str, FloatArray]] = []
        count, last_s = 0, -np.inf
        for block in self._blocks():
            n = _rows(block)
            waiting.append(
                {name: block.columns.get(name, np.full(n, np.nan)).astype(float) for name in names}
            )
            count += n
            if count >= _CHUNK_ROWS:
                last_s = self._checked(waiting, last_s)
                yield _csv(waiting, names)
                waiting, count = [], 0
        if waiting:
            self._checked(waiting, last_s)
            yield _csv(waiting, names)

    def _checked(self, parts: list[Mapping[str, FloatArray]], last_s: float) -> float:
        """Refuse what `write_trace` refuses; return the last time, s."""
        time_s = np.concatenate([part["time_s"] for part in parts])
        steps = np.diff(time_s, prepend=last_s)
        infinite = any(np.isinf(values).any() for part in parts for values in part.values())
        if infinite or not (np.isfinite(time_s).all() and (steps > 0.0).all()):
            what = "a sample is infinite" if infinite else "time_s does not increase strictly"
            raise DataError(what, where=str(self.path), fix="this trace cannot be stored")
        return float(time_s[-1])


def survey_samples(
    path: Path, counts: Callable[[SampleCount], bool] = lambda _group: True
) -> JournalSamples:
    """Find out what samples a journal holds, and which of them count."""
    groups = [SampleCount(None, 1)]
    for _, block in _numbered(path, groups):
        groups[-1].rows += _rows(block)
        groups[-1].names.update(dict.fromkeys(block.columns))
    last = {group.step: number for number, group in enumerate(groups) if group.rows}
    kept = frozenset(
        number
        for number, group in enumerate(groups)
        if group.rows and counts(group) and (group.step is None or last[group.step] == number)
    )
    return JournalSamples(Path(path), tuple(groups), kept)


def _rows(block: JournalBlock) -> int:
    return len(next(iter(block.columns.values()), ()))


def _numbered(
    path: Path, groups: list[SampleCount] | None = None
) -> Iterator[tuple[int, JournalBlock]]:
    """Yield sample blocks with the number of their acquisition; note acquisitions in `groups`."""
    number = 0
    for block in iter_journal(path):
        event = block.extra.get("event") if block.kind == "event" else None
        if event == "acquisition":
            number += 1
            if groups is not None:
                step = block.extra.get("step")
                groups.append(SampleCount(step, int(block.extra.get("attempt", 1))))
        elif event == "acquired" and groups is not None:
            groups[-1].complete = True
        elif block.kind == "samples" and _rows(block):
            yield number, block


def _csv(parts: list[Mapping[str, FloatArray]], names: tuple[str, ...]) -> bytes:
    cells = [
        list(map(repr, np.concatenate([part[name] for part in parts]).tolist())) for name in names
    ]
    return ("\n".join(map(",".join, zip(*cells, strict=True))) + "\n").encode()
