"""What counts in a journal whose points or acquisitions were taken more than once.

A block of kind ``event`` holds ``event`` in its `extra`. Three of them decide what counts:

* ``reopened`` (``point``, ``why``): the reading of that point stays, but counts no more;
* ``acquisition`` (``step``, ``attempt``): the samples behind it belong to that step, in place of
  those of an earlier attempt;
* ``acquired`` (``step``): the acquisition came to its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hdbench.records.journal import JournalBlock, JournalContent

__all__ = ["ReadingEntry", "SampleGroup", "reading_entries", "sample_groups", "standing_blocks"]


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


@dataclass(frozen=True, slots=True)
class SampleGroup:
    """The sample blocks of one acquisition.

    Parameters
    ----------
    step : int or None
        Step of the plan; None where the journal names none.
    attempt : int
        Which attempt of this step, from 1.
    blocks : tuple of JournalBlock
        In order; blocks without samples are left out.
    complete : bool
        Whether the acquisition came to its end.
    superseded : bool
        True where a later attempt of the same step counts.
    """

    step: int | None
    attempt: int
    blocks: tuple[JournalBlock, ...]
    complete: bool
    superseded: bool


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


def sample_groups(content: JournalContent) -> tuple[SampleGroup, ...]:
    """Return the samples of a journal by acquisition, and which of them count."""
    raw: list[tuple[int | None, int, list[JournalBlock], list[str]]] = [(None, 1, [], [])]
    for block in content.blocks:
        event = block.extra.get("event") if block.kind == "event" else None
        if event == "acquisition":
            raw.append((block.extra.get("step"), int(block.extra.get("attempt", 1)), [], []))
        elif event == "acquired":
            raw[-1][3].append(event)
        elif block.kind == "samples" and len(next(iter(block.columns.values()), ())):
            raw[-1][2].append(block)
    kept = [group for group in raw if group[2]]
    last = {step: number for number, (step, *_) in enumerate(kept) if step is not None}
    return tuple(
        SampleGroup(
            step,
            attempt,
            tuple(blocks),
            bool(marks),
            step is not None and last[step] != number,
        )
        for number, (step, attempt, blocks, marks) in enumerate(kept)
    )


def standing_blocks(groups: Sequence[SampleGroup]) -> list[JournalBlock]:
    """Return the sample blocks that count."""
    return [block for group in groups if not group.superseded for block in group.blocks]
