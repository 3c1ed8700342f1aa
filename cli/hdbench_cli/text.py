"""Numbers, tables and small curves as text for a terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table
    from rich.text import Text

Line: TypeAlias = "RenderableType"
Lines: TypeAlias = "Iterator[RenderableType]"
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


def styled(*parts: str | tuple[str, str]) -> Text:
    """Return one line of parts, each a text alone or with its style."""
    from rich.text import Text

    return Text.assemble(*parts)


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
