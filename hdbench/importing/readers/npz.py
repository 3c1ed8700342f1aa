"""NumPy's .npz and .npy files, by NumPy's format routines; no pickle is ever opened."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from hdbench.importing.readers.arrays import ArraySource, NamedArray
from hdbench.importing.source import Source, damaged

_FORM = "NumPy file"
# an array that is stored by columns, or packed, is read as a whole: 256 MB of it
_MOST_BYTES = 256 << 20
_Open = Callable[[], IO[bytes]]


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = npy.read_magic(file)
    if version == (1, 0):
        return npy.read_array_header_1_0(file)
    return npy.read_array_header_2_0(file)


class _Array:
    """One array in a file: rows are read in order, without the rest of it in memory."""

    def __init__(self, path: Path, name: str, opener: _Open) -> None:
        self._path, self._name, self._opener = path, name, opener
        self._file: IO[bytes] | None = None
        self._at = 0
        with opener() as file:
            self.shape, self._by_columns, self.dtype = _header(file)
        if self.dtype.hasobject:
            raise damaged(path, _FORM, f"array {name!r} holds objects, which are never unpickled")
        size = int(np.prod(self.shape, dtype=object)) * self.dtype.itemsize
        if self._by_columns and len(self.shape) > 1 and size > _MOST_BYTES:
            raise damaged(path, _FORM, f"array {name!r} of {size} bytes is stored by columns")

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Return rows; a matrix that is stored by columns is read whole."""
        if self._by_columns and len(self.shape) > 1:
            with self._opener() as file:
                return np.asarray(npy.read_array(file, allow_pickle=False))[start:stop]
        inner = self.shape[1:]
        row = self.dtype.itemsize * int(np.prod(inner, dtype=object))
        if self._file is None or start != self._at:
            self.close()
            self._file = self._opener()
            _header(self._file)
            self._at = 0
        while self._at < start:
            step = min(start - self._at, max(1, (1 << 24) // max(row, 1)))
            self._exactly(step * row)
            self._at += step
        data = self._exactly((stop - start) * row)
        self._at = stop
        return np.frombuffer(data, dtype=self.dtype).reshape((stop - start, *inner))

    def _exactly(self, count: int) -> bytes:
        data = b"" if self._file is None else self._file.read(count)
        if len(data) != count:
            raise damaged(
                self._path, _FORM, f"array {self._name!r} ends {count - len(data)} bytes short"
            )
        return data

    def close(self) -> None:
        """Give the file back."""
        if self._file is not None:
            self._file.close()
            self._file = None


def open_file(path: Path) -> Source:
    """Open a NumPy file."""
    with path.open("rb") as file:
        single = file.read(6) == b"\x93NUMPY"
    if single:
        source = _source(path, {path.stem: lambda: path.open("rb")}, None)
        _check_length(path)
        return source
    archive = zipfile.ZipFile(path)
    members = [name for name in archive.namelist() if name.endswith(".npy")]
    names = {name.removesuffix(".npy"): (lambda name=name: archive.open(name)) for name in members}
    return _source(path, names, archive)


def _check_length(path: Path) -> None:
    """Refuse a single array with something behind it."""
    with path.open("rb") as file:
        shape, _, dtype = _header(file)
        needed = file.tell() + int(np.prod(shape, dtype=object)) * dtype.itemsize
    if path.stat().st_size > needed:
        raise damaged(path, _FORM, f"{path.stat().st_size} bytes, its array ends at {needed}")


def _source(path: Path, names: Mapping[str, _Open], archive: zipfile.ZipFile | None) -> Source:
    arrays = [_Array(path, name, opener) for name, opener in names.items()]

    def close() -> None:
        for array in arrays:
            array.close()
        if archive is not None:
            archive.close()

    named = [
        NamedArray(name, array.shape, array.dtype, array.read)
        for name, array in zip(names, arrays, strict=True)
    ]
    return ArraySource(path, _FORM, named, close)
