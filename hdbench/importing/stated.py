"""What a foreign log says of itself: its time column, the lines before its table."""

from __future__ import annotations

from datetime import UTC, datetime

from hdbench.importing.convert import decimal_cell
from hdbench.importing.layout import EPOCH_1904_S
from hdbench.importing.source import Channel, Source

__all__ = ["own_time", "since_1904", "told_by_file"]

# a device has at most some 100 channels with a line each; a person reads no more than these
_SHOWN_LINES, _SHOWN_CHARACTERS = 20, 120


def own_time(source: Source, clock: str) -> Channel | None:
    """Return the channel that a file names as the time of a clock; None where there is none."""
    return next((c for c in source.channels if c.is_time and c.clock == clock), None)


def told_by_file(source: Source) -> list[str]:
    """Return what a file tells beside its table: which input is which channel may stand there."""
    lines = source.notes[:_SHOWN_LINES]
    return [f"{source.path}: {line[:_SHOWN_CHARACTERS]}" for line in lines]


def since_1904(source: Source, time: str) -> list[str]:
    """Return when a log of LabJack began, where its time counts from 1904."""
    piece = next(iter(source.pieces([time])), None)
    first = None if piece is None else decimal_cell(source, time, str(piece[time][0]), 0)
    # seconds since 1904 of any day after 1970; no run counts 66 years from its own start
    if first is None or not EPOCH_1904_S < first < 2 * EPOCH_1904_S:
        return []
    start = datetime.fromtimestamp(float(first) - EPOCH_1904_S, UTC)
    return [f"{source.path}: time since 1904-01-01 UTC: {start:%Y-%m-%dT%H:%M:%SZ}"]
