"""JSON lists of records and JSON lines, record by record."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np
from pydantic_core import from_json

from hdbench.importing import source
from hdbench.importing.layout import stamp_seconds
from hdbench.importing.units import is_time_name, stated_unit

_FORM = "JSON file"
_BLOCK = 1 << 20
# one record or one value beside the records; more is no record of samples
_LONGEST = 8 << 20
# records that say which channels there are
_PROBED = 200
_BLANKS = re.compile(r"[\s,]*")
_LAST_RECORD = re.compile(r"\}\s*,\s*\{")
_NESTED = frozenset((dict, list))
_Record = tuple[str, Mapping[str, Any]]


class _Text:
    """A window on the text of a file that moves along."""

    def __init__(self, path: Path, file: IO[str]) -> None:
        self._path, self._file = path, file
        self._text, self._at, self._done = "", 0, False
        self._alike = True
        self._decoder = json.JSONDecoder()

    def _more(self) -> bool:
        block = "" if self._done else self._file.read(_BLOCK)
        if "\0" in block:
            raise source.damaged(self._path, _FORM, "it holds a NUL character")
        self._text, self._at = self._text[self._at :] + block, 0
        self._done = not block
        return not self._done

    def peek(self) -> str:
        """Return the next character that is neither blank nor comma; empty at the end."""
        while True:
            found = _BLANKS.match(self._text, self._at)
            self._at = found.end() if found else self._at
            if self._at < len(self._text):
                return self._text[self._at]
            if not self._more():
                return ""

    def skip(self, expected: str) -> None:
        """Pass one character over."""
        if self.peek() != expected:
            found = self.peek() or "the end of the file"
            raise source.damaged(self._path, _FORM, f"found {found!r}, needed: {expected!r}")
        self._at += 1

    def several(self) -> list[Any]:
        """Return the next values: as many as stand in the window, where these are plain records."""
        if not self._alike:
            return [self.value()]
        ends = [match.end() for match in _LAST_RECORD.finditer(self._text, self._at)]
        if not ends:
            return [self.value()]
        stop = self._text.rindex("}", self._at, ends[-1] - 1) + 1
        try:
            values: list[Any] = from_json(f"[{self._text[self._at : stop]}]")
        except ValueError:
            # cut within a record, or damaged: from here on one after another
            self._alike = False
            return [self.value()]
        self._at = stop
        return values

    def value(self) -> Any:
        """Return the next value."""
        self.peek()
        while True:
            try:
                value, end = self._decoder.raw_decode(self._text, self._at)
            except json.JSONDecodeError as error:
                cut = error.msg
            except RecursionError:
                raise source.damaged(self._path, _FORM, "nested too deeply") from None
            else:
                # a number at the end of the window may go on behind it
                if end < len(self._text) or self._done or isinstance(value, dict | list | str):
                    self._at = end
                    return value
                cut = "the end of the file"
            if len(self._text) - self._at > _LONGEST or not self._more():
                raise source.damaged(self._path, _FORM, cut)


def _records(text: _Text, other: dict[str, Any]) -> Iterator[_Record]:
    """Yield the records of a text; single values beside them go to `other`."""
    while mark := text.peek():
        if mark == "[":
            text.skip("[")
            yield from _list(text, "")
        elif mark == "{":
            yield from _object(text, other)
        else:
            text.value()


def _list(text: _Text, name: str) -> Iterator[_Record]:
    while text.peek() not in ("]", ""):
        for record in text.several():
            if isinstance(record, dict):
                yield name, _flat(record)
    text.skip("]")


def _object(text: _Text, other: dict[str, Any]) -> Iterator[_Record]:
    """Yield the records in an object; an object without lists of records is one itself."""
    text.skip("{")
    own: dict[str, Any] = {}
    nested = False
    while text.peek() not in ("}", ""):
        key = str(text.value())
        text.skip(":")
        if text.peek() == "[":
            text.skip("[")
            if text.peek() == "{":
                nested = True
                yield from _list(text, f"{key}/")
                continue
            values: list[Any] = []
            while text.peek() not in ("]", ""):
                value = text.value()
                if len(values) < source.MOST_CHANNELS:
                    values.append(value)
            text.skip("]")
            own[key] = values
        else:
            own[key] = text.value()
    text.skip("}")
    if nested:
        other.update(_flat(own))
    else:
        yield "", _flat(own)


def _flat(record: Mapping[str, Any], before: str = "", depth: int = 0) -> dict[str, Any]:
    """Return a record with the names of inner objects and the numbers of lists in the keys."""
    if not before and _NESTED.isdisjoint(map(type, record.values())):
        return dict(record)
    flat: dict[str, Any] = {}
    for key, value in record.items():
        if isinstance(value, dict) and depth < 8:
            flat.update(_flat(value, f"{before}{key}/", depth + 1))
        elif isinstance(value, list):
            if len(value) <= 512:
                flat.update({f"{before}{key}[{k}]": item for k, item in enumerate(value)})
        else:
            flat[f"{before}{key}"] = value
    return flat


class _JsonSource(source.Source):
    row_word = "record"

    def __init__(self, path: Path) -> None:
        super().__init__(path, _FORM)
        other: dict[str, Any] = {}
        useful: dict[tuple[str, str], bool] = defaultdict(bool)
        stamped: set[tuple[str, str]] = set()
        for group, record in islice(self._all(other), _PROBED + 1):
            for key, value in record.items():
                useful[group, key] |= isinstance(value, int | float | str)
                if isinstance(value, str) and stamp_seconds(value) is not None:
                    stamped.add((group, key))
        made = []
        for group, key in (place for place, is_useful in useful.items() if is_useful):
            is_stamp = (group, key) in stamped
            unit = "s" if is_stamp else stated_unit(key)
            timed = is_stamp or is_time_name(key)
            made.append((source.Channel(f"{group}{key}", unit, group, timed), (group, key)))
        self._keys = self.hold(made)
        self.notes = tuple(
            f"{source.spelled(key)} = {source.spelled(str(value))[:40]}"
            for key, value in other.items()
            if isinstance(value, str | int | float)
        )

    def _all(self, other: dict[str, Any]) -> Iterator[_Record]:
        with self.path.open(encoding="utf-8-sig") as file:
            yield from _records(_Text(self.path, file), other)

    def pieces(self, names: Sequence[str]) -> Iterator[source.Piece]:
        keys = [self._keys[name][1] for name in names]
        group = self._keys[names[0]][0]
        most = source.piece_rows(8 * len(names))
        rows = (list(map(record.get, keys)) for found, record in self._all({}) if found == group)
        while some := list(islice(rows, most)):
            yield _piece(names, some)


def _piece(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> source.Piece:
    piece: dict[str, Any] = {}
    for name, values in zip(names, zip(*rows, strict=True), strict=True):
        kinds = set(map(type, values))
        if str in kinds:
            piece[name] = source.text_cells(
                ["" if value is None else str(value) for value in values]
            )
        elif kinds == {float}:
            piece[name] = np.array(values)
        else:
            piece[name] = np.array([source.finite_or_nan(value) for value in values])
    return piece


def open_file(path: Path) -> source.Source:
    """Open a JSON file."""
    return _JsonSource(path)
