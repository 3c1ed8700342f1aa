"""ROS messages as numbers with names, by the definition of their type and without code of it.

Both wire forms are read: CDR of ROS 2 (aligned, either byte order) and that of ROS 1 (packed,
little-endian). The definition may come from the file, so nothing of it is ever executed.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

__all__ = ["RosMessage"]

_SIZES = {
    "bool": ("B", 1),
    "byte": ("B", 1),
    "char": ("B", 1),
    "octet": ("B", 1),
    "int8": ("b", 1),
    "uint8": ("B", 1),
    "int16": ("h", 2),
    "uint16": ("H", 2),
    "int32": ("i", 4),
    "uint32": ("I", 4),
    "int64": ("q", 8),
    "uint64": ("Q", 8),
    "float32": ("f", 4),
    "float64": ("d", 8),
}
_BASE, _NAME, _ARRAY = 1, 2, 3
_DEEPEST = 16
# messages in a list within a message that are taken apart
_MOST_INNER = 64


class RosMessage:
    """One message, taken apart.

    Parameters
    ----------
    types : mapping
        Definitions by name: constants, and pairs of name and description of each field.
    data : bytes
        The message.
    ros2 : bool
        Whether it is CDR.
    """

    def __init__(self, types: Mapping[str, Any], data: bytes, *, ros2: bool) -> None:
        self._types = types
        self._order = "<"
        self._data = data
        self._ros2 = ros2
        if ros2:
            if len(data) < 4 or data[0] != 0 or data[1] > 1:
                raise ValueError("a message that is not plain CDR")
            self._order = "<" if data[1] else ">"
            self._data = data[4:]
        self._at = 0

    def fields(self, name: str) -> dict[str, Any]:
        """Return the values of a message of a type by their paths: numbers, arrays, text."""
        found: dict[str, Any] = {}
        self._message(name, "", found, 0)
        return found

    def _message(self, name: str, before: str, found: dict[str, Any], depth: int) -> None:
        if depth > _DEEPEST:
            raise ValueError("messages nested too deeply")
        for field, description in self._types[name][1]:
            self._field(description, f"{before}{field}", found, depth)

    def _field(self, description: Any, path: str, found: dict[str, Any], depth: int) -> None:
        kind, what = int(description[0]), description[1]
        if kind == _BASE:
            found[path] = self._base(what[0])
        elif kind == _NAME:
            self._message(what, f"{path}/", found, depth + 1)
        else:
            inner, length = what
            count = length if kind == _ARRAY else self._number("I", 4)
            self._list(inner, count, path, found, depth)

    def _list(self, inner: Any, count: int, path: str, found: dict[str, Any], depth: int) -> None:
        # each element takes a byte at least
        if count > len(self._data) - self._at:
            raise ValueError(f"{path} claims {count} elements")
        if int(inner[0]) == _BASE and inner[1][0] in _SIZES:
            code, size = _SIZES[inner[1][0]]
            if count:
                self._align(size)
            values = np.frombuffer(self._take(count * size), dtype=f"{self._order}{code}")
            found[path] = values
        elif int(inner[0]) == _BASE:
            found[path] = [self._base(inner[1][0]) for _ in range(count)]
        else:
            for k in range(count):
                kept = found if k < _MOST_INNER else {}
                self._field(inner, f"{path}[{k}]", kept, depth)

    def _base(self, name: str) -> Any:
        if name in _SIZES:
            return self._number(*_SIZES[name])
        if name != "string":
            raise ValueError(f"a field of type {name!r:.40}")
        raw = self._take(self._number("I", 4))
        return (raw[:-1] if self._ros2 else raw).decode("utf-8", "replace")

    def _number(self, code: str, size: int) -> Any:
        self._align(size)
        return struct.unpack(f"{self._order}{code}", self._take(size))[0]

    def _align(self, size: int) -> None:
        if self._ros2:
            self._at += -self._at % size

    def _take(self, size: int) -> bytes:
        data = self._data[self._at : self._at + size]
        if len(data) != size:
            raise ValueError(f"a message ends {size - len(data)} bytes short")
        self._at += size
        return data
