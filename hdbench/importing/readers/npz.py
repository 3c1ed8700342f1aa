"""NumPy's .npz and .npy files, by NumPy's format routines; no pickle is ever opened."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from contextlib import ExitStack
from functools import cached_property, partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from hdbench.importing.readers.arrays import ArraySource, NamedArray
from hdbench.importing.source import Source, closed_on_error, damaged

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
    """One array in a file: rows are read without the rest of it in memory."""

    def __init__(self, path: Path, name: str, opener: _Open, held: ExitStack) -> None:
        self._path, self._name, self._opener, self._held = path, name, opener, held
        with opener() as file:
            self.shape, by_columns, self.dtype = _header(file)
            self._begin = file.tell()
        size = int(np.prod(self.shape, dtype=object)) * self.dtype.itemsize
        self.end = self._begin + size
        self._whole = by_columns and len(self.shape) > 1
        if self.dtype.hasobject:
            raise damaged(path, _FORM, f"array {name!r} holds objects, which are never unpickled")
        if self._whole and size > _MOST_BYTES:
            raise damaged(path, _FORM, f"array {name!r} of {size} bytes is stored by columns")

    @cached_property
    def _file(self) -> IO[bytes]:
        return self._held.enter_context(self._opener())

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Return rows; a matrix that is stored by columns is read whole."""
        if self._whole:
            with self._opener() as file:
                return np.asarray(npy.read_array(file, allow_pickle=False))[start:stop]
        inner = self.shape[1:]
        row = self.dtype.itemsize * int(np.prod(inner, dtype=object))
        self._file.seek(self._begin + start * row)
        count = (stop - start) * row
        data = self._file.read(count)
        if len(data) != count:
            short = f"array {self._name!r} ends {count - len(data)} bytes short"
            raise damaged(self._path, _FORM, short)
        return np.frombuffer(data, dtype=self.dtype).reshape((stop - start, *inner))


def open_file(path: Path) -> Source:
    """Open a NumPy file."""
    held = ExitStack()
    with closed_on_error(held.close):
        with path.open("rb") as file:
            single = file.read(6) == b"\x93NUMPY"
        if single:
            openers: dict[str, _Open] = {path.stem: lambda: path.open("rb")}
        else:
            archive = held.enter_context(zipfile.ZipFile(path))
            members = [name for name in archive.namelist() if name.endswith(".npy")]
            openers = {name.removesuffix(".npy"): partial(archive.open, name) for name in members}
        arrays = {name: _Array(path, name, opener, held) for name, opener in openers.items()}
        size = path.stat().st_size
        if single and size > arrays[path.stem].end:
            end = arrays[path.stem].end
            raise damaged(path, _FORM, f"{size} bytes, its array ends at {end}")
        named = [NamedArray(name, a.shape, a.dtype, a.read) for name, a in arrays.items()]
        return ArraySource(path, _FORM, named, held.close)
