"""The error table as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator

from hdbench.gauges.errortable import ErrorTable

__all__ = ["table_as_csv"]

_HEAD = ("case", "kind", "rosette", "quantity", "share_below", "value", "low", "high")
Row = tuple[str, str, int | str, str, float | str, float, float | str, float | str]


def table_as_csv(table: ErrorTable) -> str:
    """Return the table as CSV, one number per row."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_HEAD)
    writer.writerows(
        tuple(repr(cell) if isinstance(cell, float) else cell for cell in row)
        for row in _rows(table)
    )
    return text.getvalue()


def _rows(table: ErrorTable) -> Iterator[Row]:
    for name, value in table.in_place.items():
        yield "in-place", "none", "", name, "", value, "", ""
    for one in table.one_off:
        for name, value in one.effects.items():
            yield "one-off", one.kind, one.rosette, name, "", value, "", ""
    for scatter in table.scatter:
        for name, quantiles in scatter.effects.items():
            for q in quantiles:
                yield "scatter", scatter.kind, "", name, q.share, q.value, q.low, q.high
