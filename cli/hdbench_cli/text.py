"""Numbers, tables and small curves as text for a terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table
    from rich.text import Text

_BLOCKS = " ▁▂▃▄▅▆▇█"
_PLAIN = " .:-=+*#@"


def with_uncertainty(quantity: Mapping[str, Any], unit: str) -> str:
    """Return ``value +- std unit`` with two significant digits of the standard uncertainty.

    Examples
    --------
    >>> with_uncertainty({"value": 6.6123, "std": 0.0484, "dof": 3}, "N m/V")
    '6.612 +- 0.048 N m/V (3 dof)'
    """
    value, std = float(quantity["value"]), float(quantity["std"])
    if std == 0.0:
        return f"{value:.6g} {unit}"
    digits = max(0, 1 - math.floor(math.log10(std)))
    dof = quantity.get("dof")
    tail = f" ({dof:.3g} dof)" if dof is not None else ""
    return f"{value:.{digits}f} +- {std:.{digits}f} {unit}{tail}"


def probability(value: float) -> str:
    """Return a false-alarm probability: nothing is impossible, only below 1e-9.

    Examples
    --------
    >>> probability(0.0021), probability(0.0)
    ('0.0021', 'below 1e-9')
    """
    return "below 1e-9" if value < 1e-9 else f"{value:.2g}"


def remark_lines(result: Mapping[str, Any]) -> Iterator[str]:
    """Yield what makes a result doubtful (flags) and what limits it (notes)."""
    for kind in ("flags", "notes"):
        for remark in result.get(kind, ()):
            yield f"{kind[:-1]:13s} {remark['name']}: {remark['detail']}"


def table(
    heads: Sequence[str],
    rows: Iterable[Sequence[RenderableType]],
    *,
    right: Sequence[str] = (),
    title: str | None = None,
) -> Table:
    """Return a table without lines; columns named in `right` hold numbers."""
    from rich.table import Table

    out = Table(box=None, pad_edge=False, title=title, title_justify="left")
    for head in heads:
        out.add_column(head, justify="right" if head in right else "left")
    for row in rows:
        out.add_row(*row)
    return out


def wrapped(line: str, style: str = "") -> Text:
    """Return a line that a narrow terminal may wrap."""
    from rich.text import Text

    return Text(line, style=style, no_wrap=False)


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
