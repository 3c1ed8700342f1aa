"""Foreign load readings as lines of a loads file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hdbench.errors import UsageError
from hdbench.records.foreign import ForeignTable
from hdbench.records.loadsfile import LOADS_COLUMNS
from hdbench.records.mapping import SourceColumn, find_source
from hdbench.records.table import quoted
from hdbench.records.textfile import data_error

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


def _cell(table: ForeignTable, row: int, name: str, column: SourceColumn) -> str:
    if name in _TEXT:
        return table.rows[row][column.index].strip()
    value = table.decimal(row, column.index)
    if value is None:
        if name in (*_NEEDED, "torque_nm"):
            raise data_error(
                table.path,
                table.lines[row],
                f"no number for {name}; needed: one in every row",
                "fill the cell, or take the row out",
            )
        return ""
    number = float(value * column.scale + column.offset)
    whole = name in _WHOLE and number.is_integer()
    return str(int(number)) if whole else repr(number)


def _names(
    sources: Sequence[Mapping[str, str]], constants: Sequence[Mapping[str, str]]
) -> list[str]:
    given = [set(s) | set(c) for s, c in zip(sources, constants, strict=True)]
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


def loads_lines(
    tables: Sequence[ForeignTable],
    sources: Sequence[Mapping[str, str]],
    constants: Sequence[Mapping[str, str]],
) -> tuple[tuple[str, ...], bytes]:
    """Join foreign readings into one loads file.

    Parameters
    ----------
    tables : sequence of ForeignTable
        The files, in the order of the readings.
    sources, constants : sequence of mapping
        For each file: source of each column, value of each constant column.

    Returns
    -------
    names : tuple of str
        Columns.
    content : bytes
        The loads file.

    Raises
    ------
    UsageError
        If a column is missing.
    DataError
        If a cell is no number (with its line).
    """
    names = _names(sources, constants)
    lines = [",".join(names)]
    for table, source, constant in zip(tables, sources, constants, strict=True):
        columns = {name: find_source(table, text, "--map") for name, text in source.items()}
        for row in range(len(table.rows)):
            cells = [
                _cell(table, row, name, columns[name]) if name in columns else constant[name]
                for name in names
            ]
            lines.append(",".join(map(quoted, cells)))
    return tuple(names), ("\n".join(lines) + "\n").encode()
