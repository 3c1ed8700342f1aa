"""What a journal holds, counted without keeping it in memory."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from hdbench.records.journalreading import JournalBlock, iter_journal, read_journal

__all__ = ["JournalSummary", "summarize_journal"]


@dataclass(frozen=True, slots=True)
class JournalSummary:
    """Counts of a journal.

    Parameters
    ----------
    samples, readings : int
        Acknowledged samples and load readings.
    torn_bytes : int
        Bytes of an unfinished last block, never acknowledged.
    problem : str or None
        Damage in the middle, as `JournalContent` tells it.
    """

    samples: int = 0
    readings: int = 0
    torn_bytes: int = 0
    problem: str | None = None

    def count(self, kind: str) -> int:
        """Return the number of ``samples`` or of readings (``reading``)."""
        return self.readings if kind == "reading" else self.samples


def summarize_journal(path: Path) -> JournalSummary:
    """Count what a journal holds."""
    counted: Counter[str] = Counter()
    rests: list[int] = []
    expected, straight, behind = 0, True, 0
    for block in iter_journal(path, rests):
        counted[block.kind] += 1 if block.kind == "reading" else _rows(block)
        straight = straight and block.sequence == expected
        expected += 1
        behind += bool(rests)
    samples, readings = counted["samples"], counted["reading"]
    if straight and expected and not behind:
        return JournalSummary(samples, readings, rests[0])
    # damaged, or nothing intact in it: what exactly is the matter takes the whole file
    content = read_journal(path)
    return JournalSummary(samples, readings, content.torn_bytes, content.problem)


def _rows(block: JournalBlock) -> int:
    return len(next(iter(block.columns.values()), ()))
