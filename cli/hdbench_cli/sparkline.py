"""Small pictures for a terminal: a curve in one line of characters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

__all__ = ["read_columns", "span_of", "sparkline"]

_BLOCKS = " ▁▂▃▄▅▆▇█"
_PLAIN = " .:-=+*#@"


def sparkline(
    values: Sequence[float], width: int, span: tuple[float, float], *, plain: bool = False
) -> str:
    """Return a curve as one line of block characters.

    Examples
    --------
    >>> sparkline([0.0, 1.0, 2.0, 3.0], 4, (0.0, 3.0), plain=True)
    '.:-@'
    """
    marks = _PLAIN if plain else _BLOCKS
    low, high = span
    width = max(1, min(width, len(values)))
    out = []
    for place in range(width):
        part = values[place * len(values) // width : (place + 1) * len(values) // width]
        good = [value for value in part if math.isfinite(value)]
        if not good or not high > low:
            out.append(marks[0] if not good else marks[1])
            continue
        share = (sum(good) / len(good) - low) / (high - low)
        out.append(marks[1 + max(0, min(len(marks) - 2, round(share * (len(marks) - 2))))])
    return "".join(out)


def read_columns(path: Path) -> Mapping[str, list[float]] | None:
    """Return the columns of a table that a diagnosis wrote; None where there is no such file."""
    if not path.is_file():
        return None
    head, *rows = path.read_text(encoding="utf-8").splitlines()
    cells = [[float(cell) if cell else math.nan for cell in row.split(",")] for row in rows]
    return {name: [row[at] for row in cells] for at, name in enumerate(head.split(","))}


def span_of(columns: Mapping[str, Sequence[float]], *names: str) -> tuple[float, float]:
    """Return lowest and highest finite value of some columns, the span of a common picture."""
    values = [v for name in names for v in columns[name] if math.isfinite(v)]
    return (min(values), max(values)) if values else (0.0, 0.0)
