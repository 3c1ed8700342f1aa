"""Foreign load readings as lines of a loads file."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hdbench.errors import DataError, UsageError
from hdbench.importing.trace import Part
from hdbench.records.loads import LOADS_COLUMNS
from hdbench.records.tables import quoted
from hdbench.records.trace import FloatArray

__all__ = ["loads_lines"]

_TEXT = (
    "experiment",
    "range",
    "direction",
    "series",
    "kind",
    "loading",
    "flags",
    "excluded_at_s",
)
_WHOLE = ("n_samples", "repeat", "mounting", "n_excluded")
_NEEDED = ("experiment", "position_rad", "range", "direction", "series", "reading_v")


def _cells(part: Part, name: str) -> list[str]:
    """Return a column of one file as the cells of a loads file."""
    if name in part.constants:
        return [part.constants[name]]
    conversion = part.conversions[name]
    channel = conversion.column.channel.name
    cells: list[str] = []
    for piece in part.source.pieces([channel]):
        raw = piece[channel]
        if name in _TEXT:
            cells += [str(cell).strip() for cell in raw.tolist()]
        else:
            values = conversion.piece(raw, len(cells))
            _check(part, name, values, len(cells))
            cells += [_number(name, value) for value in values.tolist()]
    return cells


def _check(part: Part, name: str, values: FloatArray, row: int) -> None:
    missing = np.flatnonzero(np.isnan(values))
    if len(missing) and name in (*_NEEDED, "torque_nm"):
        raise DataError(
            f"no number for {name}; needed: one in every row",
            where=part.source.place(row + int(missing[0])),
            fix="fill the cell, or take the row out",
        )


def _number(name: str, value: float) -> str:
    if math.isnan(value):
        return ""
    return str(int(value)) if name in _WHOLE and value.is_integer() else repr(value)


def _names(parts: Sequence[Part]) -> list[str]:
    given = [set(part.conversions) | set(part.constants) for part in parts]
    everywhere, anywhere = set.intersection(*given), set.union(*given)
    for name in (*_NEEDED, *sorted(anywhere)):
        if name not in everywhere:
            number = next(i for i, names in enumerate(given, 1) if name not in names)
            raise UsageError(
                f"no column {name} for file {number}",
                where="--map, --set",
                fix=f"give --map {name}=COLUMN or --set {number}:{name}=VALUE",
            )
    if not {"torque_nm", "mass_kg"} & everywhere:
        raise UsageError(
            "no column torque_nm or mass_kg",
            where="--map",
            fix="give --map torque_nm=COLUMN, or --map mass_kg=COLUMN with the arm of --profile",
        )
    known = [name for name in LOADS_COLUMNS if name in everywhere]
    return known + sorted(everywhere - set(known))


def loads_lines(parts: Sequence[Part]) -> tuple[tuple[str, ...], bytes]:
    """Join foreign readings into one loads file."""
    names = _names(parts)
    lines = [",".join(names)]
    for part in parts:
        columns = [_cells(part, name) for name in names]
        rows = max(map(len, columns))
        columns = [
            c * rows if n in part.constants else c for n, c in zip(names, columns, strict=True)
        ]
        if len({len(column) for column in columns}) > 1:
            raise DataError(
                "the columns have unlike numbers of rows; needed: the same for all",
                where=str(part.source.path),
                fix="map channels of one length and group",
            )
        lines += [",".join(map(quoted, cells)) for cells in zip(*columns, strict=True)]
    return tuple(names), ("\n".join(lines) + "\n").encode()
