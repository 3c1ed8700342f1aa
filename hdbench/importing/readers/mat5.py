"""MATLAB files up to version 7 (MATLAB 5 format), by SciPy."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, whosmat

from hdbench.errors import DataError
from hdbench.importing.readers.arrays import ArraySource, NamedArray
from hdbench.importing.source import Source

_FORM = "MATLAB 5 file"
_WHOLE = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
_NUMBERS = {"double", "single", "logical"} | _WHOLE
# a variable is read as a whole; larger ones are saved as version 7.3 by MATLAB itself
_MOST_BYTES = 128 << 20
_DEEPEST = 8


def _upright(array: NDArray[Any]) -> NDArray[Any]:
    """Return a row vector as a column; what is wider than long lies on its side too."""
    return array.T if array.ndim == 2 and 0 < array.shape[0] < array.shape[1] else array


def _variable(path: Path, name: str) -> NDArray[Any]:
    return _upright(np.asarray(loadmat(path, variable_names=[name])[name]))


def _rows(variable: Callable[[], NDArray[Any]], start: int, stop: int) -> NDArray[Any]:
    """Return rows of a variable that is read when it is first asked for."""
    return variable()[start:stop]


def open_file(path: Path) -> Source:
    """Open a MATLAB 5 file."""
    arrays: list[NamedArray] = []
    for name, shape, kind in whosmat(str(path)):
        size = int(np.prod(shape, dtype=object))
        if kind not in ("struct", *_NUMBERS):
            continue
        # whatever a variable claims, it cannot be larger than its file unpacks to
        if not 0 <= size * 8 <= min(_MOST_BYTES, 1100 * path.stat().st_size):
            raise DataError(
                f"variable {name!r:.60} has {size} elements; needed: at most {_MOST_BYTES // 8}",
                where=str(path),
                fix="save it with -v7.3, which is read by pieces",
            )
        if kind == "struct":
            loaded = loadmat(str(path), variable_names=[name], simplify_cells=True)[name]
            arrays += _inside(name, loaded, 0)
            continue
        upright = shape[::-1] if len(shape) == 2 and 0 < shape[0] < shape[1] else shape
        read = partial(_rows, cache(partial(_variable, path, name)))
        arrays.append(NamedArray(name, tuple(upright), np.dtype(np.float64), read))
    return ArraySource(path, _FORM, arrays)


def _inside(name: str, value: Any, depth: int) -> list[NamedArray]:
    """Return the arrays in a structure."""
    if isinstance(value, dict) and depth < _DEEPEST:
        return [
            found
            for key, inner in value.items()
            for found in _inside(f"{name}/{key}", inner, depth + 1)
        ]
    array = np.asarray(value)
    if array.dtype.kind not in "fbiu":
        return []
    array = _upright(array) if array.ndim else array.reshape(1)
    return [NamedArray(name, array.shape, array.dtype, lambda a, b: array[a:b])]
