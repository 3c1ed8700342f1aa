"""What a foreign log says of itself: its time column, its units, the lines before its table."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime

from hdbench.errors import UsageError
from hdbench.records.foreign import ForeignTable
from hdbench.records.loggers import EPOCH_1904_S, is_time_name
from hdbench.records.units import target_unit, unit_scale

__all__ = ["add_time", "in_our_units", "told_by_logger"]

# a device has at most some 100 channels with a line each; a person reads no more than these
_SHOWN_LINES, _SHOWN_CHARACTERS = 20, 120


def add_time(table: ForeignTable, sources: dict[str, str]) -> None:
    """Take the log's own time column where no other was named.

    Parameters
    ----------
    table : ForeignTable
        The file.
    sources : dict
        Source of each column; gets ``time_s`` where the file names a time in numbers.
    """
    if "time_s" in sources:
        return
    for index, name in enumerate(table.header):
        if is_time_name(name) and table.is_numeric(index):
            sources["time_s"] = name
            return


def in_our_units(
    table: ForeignTable, sources: Mapping[str, str], *, turn: bool
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Turn units that a file states into ours, or refuse what is taken for another unit.

    Parameters
    ----------
    table : ForeignTable
        The file.
    sources : mapping
        Source of each column; one with arithmetic of its own is left as it is.
    turn : bool
        Turn a stated unit into ours; else say how to.

    Returns
    -------
    sources : dict
        With a scale where one was needed.
    notes : tuple of str
        What was turned.

    Raises
    ------
    UsageError
        If a column states another unit than the one it is taken for.
    """
    turned, notes = dict(sources), []
    for target, source in sources.items():
        index, wanted = table.column(source), target_unit(target)
        if index is None or index >= len(table.units) or not wanted:
            continue
        unit = table.units[index]
        scale = unit_scale(unit, wanted)
        if scale is None or scale == 1:
            continue
        if scale.is_nan() or not turn:
            other = "map another column" if scale.is_nan() else f"{target}={source}*{scale:.17g}"
            raise UsageError(
                f"column {source!r} states {unit}; needed for {target}: {wanted}",
                where=f"{table.path}, --map",
                fix=f"{other}; or '{target}={source}*1' to take it as it is",
            )
        turned[target] = f"{source}*{scale:.17g}"
        notes.append(f"{table.path}: {source} from {unit} to {wanted}, times {scale:.6g}")
    return turned, tuple(notes)


def told_by_logger(table: ForeignTable, time: str | None) -> tuple[str, ...]:
    """Return what a logger tells beside its table.

    Parameters
    ----------
    table : ForeignTable
        The file.
    time : str or None
        Source of its time column.

    Returns
    -------
    tuple of str
        The lines before the table, for which input is which channel stands nowhere else, and the
        start where the time counts from 1904.
    """
    lines = table.preamble[:_SHOWN_LINES]
    told = [f"{table.path}: {line[:_SHOWN_CHARACTERS]}" for line in lines]
    index = None if time is None else table.column(time)
    first = None if index is None else table.decimal(0, index)
    # seconds since 1904 of any day after 1970; no run counts 66 years from its own start
    if table.logged and first is not None and EPOCH_1904_S < first < 2 * EPOCH_1904_S:
        start = datetime.fromtimestamp(float(first) - EPOCH_1904_S, UTC)
        told.append(f"{table.path}: time since 1904-01-01 UTC: {start:%Y-%m-%dT%H:%M:%SZ}")
    return tuple(told)
