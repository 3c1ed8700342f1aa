"""HDF5 files, MATLAB 7.3 among them, by h5py; nothing outside the file is followed."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdbench.errors import DataError
from hdbench.importing.readers.arrays import ArraySource, NamedArray
from hdbench.importing.source import Source, closed_on_error

h5py: Any = importlib.import_module("h5py")

_FORM = "HDF5 file"
_UNITS = ("unit", "units", "Unit", "Units", "UNIT", "UNITS", "unit_string")
_DEEPEST = 16
# a chunk is unpacked as a whole, whatever piece is read of it
_MOST_CHUNK_BYTES = 64 << 20


def _unit(dataset: Any) -> str:
    for name in _UNITS:
        value = dataset.attrs.get(name)
        if isinstance(value, bytes):
            value = value.decode("utf-8", "replace")
        if isinstance(value, str):
            return value
    return ""


def _datasets(group: Any, name: str, depth: int) -> Iterator[tuple[str, Any]]:
    for key in group:
        # a link to another file would read what nobody named
        if not isinstance(group.get(key, getlink=True), h5py.HardLink) or key.startswith("#"):
            continue
        inner = group[key]
        path = f"{name}/{key}" if name else key
        if isinstance(inner, h5py.Dataset):
            yield path, inner
        elif isinstance(inner, h5py.Group) and depth < _DEEPEST:
            yield from _datasets(inner, path, depth + 1)


def open_file(path: Path) -> Source:
    """Open an HDF5 file."""
    # another program may hold the lock of a file that is only read here
    os.environ.setdefault("HDF5_USE_FILE_LOCKING", "FALSE")
    file = h5py.File(path, "r")
    with closed_on_error(file.close):
        arrays = [
            _array(path, name, dataset)
            for name, dataset in _datasets(file, "", 0)
            if _is_table(dataset)
        ]
        return ArraySource(path, _FORM, arrays, file.close)


def _is_table(dataset: Any) -> bool:
    shape, dtype = dataset.shape, dataset.dtype
    words = dataset.attrs.get("MATLAB_class", b"")
    return (
        shape is not None
        and 1 <= len(shape) <= 2
        and (dtype.kind in "fbiu" or dtype.names is not None)
        and words not in (b"char", b"cell")
    )


def _array(path: Path, name: str, dataset: Any) -> NamedArray:
    if dataset.is_virtual or dataset.external:
        raise DataError(
            f"dataset {name!r:.80} has its data in another file; needed: in this one",
            where=str(path),
            fix="repack it, such as by h5repack, and import the result",
        )
    chunk = int(np.prod(dataset.chunks or (1,), dtype=object)) * dataset.dtype.itemsize
    if chunk > _MOST_CHUNK_BYTES:
        raise DataError(
            f"dataset {name!r:.80} has chunks of {chunk} bytes; needed: {_MOST_CHUNK_BYTES}",
            where=str(path),
            fix="repack it with smaller chunks, such as by h5repack",
        )
    shape = dataset.shape
    # MATLAB's vectors, and what lies on its side
    lying = len(shape) == 2 and shape[0] < shape[1]

    def rows(start: int, stop: int) -> NDArray[Any]:
        return np.asarray(dataset[:, start:stop].T if lying else dataset[start:stop])

    return NamedArray(name, shape[::-1] if lying else shape, dataset.dtype, rows, _unit(dataset))
