"""Arrays with names, as NumPy, MATLAB and HDF5 keep them, as channels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.importing.source import Channel, Piece, Source, numbers, piece_rows, spans, spelled
from hdbench.importing.units import is_time_name, stated_unit

# columns of one matrix that are channels; a matrix that is wider either way is no set of channels
MOST_COLUMNS = 512
_KINDS = "fbiumM"


@dataclass(frozen=True, slots=True)
class NamedArray:
    """One array of a file."""

    name: str  # its name, with the groups or structures that it is in
    shape: tuple[int, ...]
    dtype: np.dtype[Any]  # type of its elements
    read: Callable[[int, int], NDArray[Any]]  # returns the rows from one number to another
    unit: str = ""  # as the file states it


# an array, and the index of a channel in its rows: of a column, a field, or the vector itself
_Place = tuple[NamedArray, Any]


class ArraySource(Source):
    """Arrays as channels: a vector is one, a matrix one per column, a record one per field.

    Arrays of one group and one length are taken to be of one clock. A single number is no channel;
    it is told beside them.
    """

    def __init__(
        self,
        path: Path,
        form: str,
        arrays: Sequence[NamedArray],
        close: Callable[[], None] | None = None,
    ) -> None:
        super().__init__(path, form, close)
        made: list[tuple[Channel, _Place]] = []
        told: list[str] = []
        for array in arrays:
            if int(np.prod(array.shape, dtype=object)) == 1 and array.dtype.kind in "fiu":
                value = array.read(0, 1).reshape(-1)[:1]
                told += [f"{spelled(array.name)} = {v:.9g} {array.unit}".rstrip() for v in value]
                continue
            made += _channels(array)
        self._columns = self.hold(made)
        self.notes = tuple(told)

    def pieces(self, names: Sequence[str]) -> Iterator[Piece]:
        """Yield rows of the arrays."""
        columns = {name: self._columns[name] for name in names}
        arrays = {id(array): array for array, _ in columns.values()}
        rows = next(iter(arrays.values())).shape[0]
        most = piece_rows(sum(a.dtype.itemsize * (*a.shape, 1)[1] // 8 for a in arrays.values()))
        for start, count in spans(rows, most):
            read: dict[int, NDArray[Any]] = {}
            piece = {}
            for name, (array, index) in columns.items():
                # one after another: all of them are more than a processor keeps close
                if id(array) not in read:
                    read[id(array)] = array.read(start, start + count)
                values = numbers(np.asarray(read[id(array)][index]).reshape(-1))
                piece[name] = np.full(count, np.nan) if values is None else values
            yield piece


def _channels(array: NamedArray) -> list[tuple[Channel, _Place]]:
    shape = array.shape
    if not shape or len(shape) > 2 or (shape[-1] == 0 and len(shape) > 1):
        return []
    rows = shape[0]
    clock = f"{array.name.rpartition('/')[0]}:{rows}"
    found: list[tuple[Channel, _Place]] = []

    def add(name: str, dtype: np.dtype[Any], index: Any, within: str) -> None:
        if dtype.kind in _KINDS:
            unit = array.unit or stated_unit(name) or ("ns" if dtype.kind in "mM" else "")
            found.append((Channel(name, unit, within, is_time_name(name), rows), (array, index)))

    if array.dtype.names:
        for field in array.dtype.names if len(shape) == 1 else ():
            dtype = array.dtype[field]
            if not dtype.shape:
                add(f"{array.name}/{field}", dtype, field, array.name)
    elif len(shape) == 1 or shape[1] == 1:
        add(array.name, array.dtype, ..., clock)
    elif shape[1] <= MOST_COLUMNS:
        for k in range(shape[1]):
            add(f"{array.name}[{k}]", array.dtype, (slice(None), k), clock)
    return found
