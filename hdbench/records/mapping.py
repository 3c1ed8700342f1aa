"""What ``--map`` and ``--set`` of the import say, as data."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

from hdbench.errors import UsageError
from hdbench.records.foreign import ForeignTable

__all__ = ["ColumnMap", "Constant", "SourceColumn", "find_source", "parse_constant", "parse_map"]

_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_LINEAR = re.compile(
    rf"(?P<name>.+?)(?:(?P<sign>[*/])(?P<scale>-?{_NUMBER}))?(?P<offset>[+-]{_NUMBER})?"
)
_TARGET = re.compile(r"(?:(?P<file>[1-9]\d{0,3}):)?(?P<target>[a-z][a-z0-9_]*)=(?P<rest>.+)")


@dataclass(frozen=True, slots=True)
class ColumnMap:
    """One ``--map``: where a column comes from.

    Parameters
    ----------
    target : str
        Column name of the contract.
    source : str
        ``COLUMN``, ``COLUMN*SCALE``, ``COLUMN/SCALE``, each with ``+OFFSET`` or ``-OFFSET``.
    file : int or None
        Number of the file, from 1, that it is about; None for all.
    """

    target: str
    source: str
    file: int | None = None


@dataclass(frozen=True, slots=True)
class Constant:
    """One ``--set``: a column that holds the same value in every row.

    Parameters
    ----------
    target : str
        Column name of the contract.
    value : str
        Its value.
    file : int or None
        Number of the file, from 1, that it is about; None for all.
    """

    target: str
    value: str
    file: int | None = None


@dataclass(frozen=True, slots=True)
class SourceColumn:
    """A column of a foreign file and what turns its numbers into SI.

    Parameters
    ----------
    index : int
        Position from 0.
    scale, offset : Decimal
        value = cell * scale + offset.
    """

    index: int
    scale: Decimal = Decimal(1)
    offset: Decimal = Decimal(0)


def _split(
    text: str, option: str, example: str, known: Sequence[str]
) -> tuple[str, str, int | None]:
    match = _TARGET.fullmatch(text)
    if match is None:
        raise UsageError(
            f"found {text!r:.80}; needed: [FILE_NUMBER:]NAME=...", where=option, fix=example
        )
    target = match["target"]
    near = difflib.get_close_matches(target, known, n=1, cutoff=0.75)
    if target not in known and near:
        raise UsageError(f"no column {target!r}", where=option, fix=f"did you mean {near[0]!r}?")
    return target, match["rest"], int(match["file"]) if match["file"] else None


def parse_map(text: str, known: Sequence[str]) -> ColumnMap:
    """Parse ``[FILE_NUMBER:]NAME=COLUMN[*SCALE][+OFFSET]``.

    Parameters
    ----------
    text : str
        What stands behind ``--map``.
    known : sequence of str
        Column names of the contract; a name near one of them is taken for a slip.

    Returns
    -------
    ColumnMap

    Raises
    ------
    UsageError
        If it has another form.
    """
    return ColumnMap(*_split(text, "--map", "such as --map torque_nm=Torque*0.001", known))


def parse_constant(text: str, known: Sequence[str]) -> Constant:
    """Parse ``[FILE_NUMBER:]NAME=VALUE``.

    Parameters
    ----------
    text : str
        What stands behind ``--set``.
    known : sequence of str
        As for `parse_map`.

    Returns
    -------
    Constant

    Raises
    ------
    UsageError
        If it has another form.
    """
    return Constant(*_split(text, "--set", "such as --set 2:series=down", known))


def find_source(table: ForeignTable, source: str, option: str) -> SourceColumn:
    """Return the column that `source` means; a column's own name goes before arithmetic.

    Parameters
    ----------
    table : ForeignTable
        The file.
    source : str
        As in `ColumnMap`.
    option : str
        Option it was given by, for messages.

    Returns
    -------
    SourceColumn

    Raises
    ------
    UsageError
        If there is no such column, or the scale is 0.
    """
    exact = table.column(source)
    if exact is not None:
        return SourceColumn(exact)
    match = _LINEAR.fullmatch(source)
    index = None if match is None else table.column(match["name"])
    if match is None or index is None:
        near = difflib.get_close_matches(source, table.header, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        names = ", ".join(table.header[:12]) if table.header else f"1 to {table.width}"
        raise UsageError(
            f"no column {source!r:.80} in {table.path}",
            where=option,
            fix=f"{hint}columns: {names}{', ...' if len(table.header) > 12 else ''}",
        )
    scale = Decimal(match["scale"] or 1)
    if scale == 0:
        raise UsageError(f"scale 0 in {source!r:.80}", where=option, fix="give another scale")
    if match["sign"] == "/":
        scale = 1 / scale
    return SourceColumn(index, scale, Decimal(match["offset"] or 0))
