"""TOML text that may be hostile: read with a place for every refusal, and the line of every key."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hdbench.errors import DataError, ProfileError
from hdbench.records.storage import file_bytes

Key = tuple[str | int, ...]

# the built-in profile has 8 kB in 150 lines; a parser takes seconds for a megabyte of brackets
_LIMIT_BYTES = 256_000
_LIMIT_LINES = 10_000
_MAX_DEPTH = 32
_MAX_PARTS = 16
_TOKEN = re.compile(
    r"(?P<space>[ \t]+)"
    r"|(?P<newline>\r?\n)"
    r"|(?P<comment>\#[^\n]*)"
    r'|(?P<string>"""(?:\\[\s\S]|[^\\])*?"""(?:"{0,2})'
    r"|'''[\s\S]*?'''(?:'{0,2})"
    r'|"(?!"")(?:\\.|[^"\\\n])*"'
    r"|'(?!'')[^'\n]*')"
    r"|(?P<mark>[\[\]{},=.])"
    r"|(?P<bare>[^\s\[\]{},=.\"'\#]+)"
)
_PLACE = re.compile(r" \(at line (\d+), column (\d+)\)$")


def toml_text(path: Path, fix: str, what: str = "profile") -> str:
    """Read a TOML file as text; `fix` is what to do where there is none."""
    try:
        raw = file_bytes(path, limit=_LIMIT_BYTES, what=what, missing=fix)
    except DataError as error:
        raise ProfileError(error.what, where=error.where, fix=error.fix) from error
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ProfileError(
            "not UTF-8 text", where=f"{path}:{line}", fix="save the file as UTF-8"
        ) from error


def read_toml(text: str, path: str) -> dict[str, Any]:
    """Parse TOML text that may be hostile."""
    lines = text.count("\n") + 1
    for count, most, what in (
        (len(text), _LIMIT_BYTES, "characters"),
        (lines, _LIMIT_LINES, "lines"),
    ):
        if count > most:
            what = f"{count} {what}; needed: at most {most}"
            raise ProfileError(what, where=path, fix="check that this is a profile")
    deep = nesting_problem(text)
    if deep is not None:
        line, what = deep
        raise ProfileError(what, where=f"{path}:{line}", fix="profiles nest three levels at most")
    try:
        return tomllib.loads(text)
    except ValueError as error:
        raise _syntax_error(str(error), text, path) from error


def tuples(value: Any) -> Any:
    """Return what TOML or JSON holds with tuples in place of lists, as frozen models hold them."""
    if isinstance(value, dict):
        return {name: tuples(item) for name, item in value.items()}
    if isinstance(value, list):
        return tuple(tuples(item) for item in value)
    return value


def _syntax_error(message: str, text: str, path: str) -> ProfileError:
    place = _PLACE.search(message)
    if place is None:
        end = text.count("\n") + 1
        where = f"{path}:{end}" if "end of document" in message else path
        return ProfileError(f"not TOML: {message}", where=where, fix="correct the syntax")
    line, column = int(place[1]), int(place[2])
    shown = text.replace("\r\n", "\n").split("\n")[line - 1].strip()[:60]
    fix = f"correct line {line}: {shown}"
    if "overwrite" in message or "twice" in message:
        fix = f"a key stands twice; take one out (line {line}: {shown})"
    return ProfileError(
        f"not TOML: {message[: place.start()]}", where=f"{path}:{line}:{column}", fix=fix
    )


def _tokens(text: str) -> Iterator[tuple[str, str, int]]:
    """Yield kind, text and line of the tokens of a TOML text, up to the first that is none."""
    place, line = 0, 1
    while (match := _TOKEN.match(text, place)) is not None:
        kind, word = str(match.lastgroup), match.group()
        if kind not in ("space", "comment"):
            yield kind, word, line
        line += word.count("\n")
        place = match.end()


def nesting_problem(text: str) -> tuple[int, str] | None:
    """Return where a text nests deeper than any profile does, before a parser recurses into it."""
    depth = dots = 0
    for kind, word, line in _tokens(text):
        if word in ("[", "{"):
            depth += 1
        elif word in ("]", "}"):
            depth = max(0, depth - 1)
        if word == ".":
            dots += 1
        elif kind in ("mark", "newline"):
            dots = 0
        if depth > _MAX_DEPTH:
            return line, f"brackets nest deeper than {_MAX_DEPTH}"
        if dots > _MAX_PARTS:
            return line, f"a key has more than {_MAX_PARTS} parts"
    return None


@dataclass(slots=True)
class _Open:
    """A table or an array whose content is being read."""

    path: Key
    entry: int | None = None  # of an array: number of the entry that is read
    value: Key | None = None  # key whose value comes; None of a table before the "="
    names: list[str] = field(default_factory=list)  # parts of the key that is read
    brackets: int = 0  # before the names: the line is the header of a table


class _LineMap:
    """Lines of the keys of a valid TOML text, by its tokens."""

    def __init__(self) -> None:
        self.lines: dict[Key, int] = {(): 1}
        self._last: dict[Key, int] = {}  # number of the last entry of an array of tables
        self._opened = [_Open(())]

    def take(self, kind: str, word: str, line: int) -> None:
        """Read one token."""
        inner = self._opened[-1]
        if kind == "newline":
            if len(self._opened) == 1:
                self._opened = [_Open(self._header(inner, line) if inner.brackets else inner.path)]
        elif word == ",":
            inner.names = []
            inner.entry = None if inner.entry is None else inner.entry + 1
            inner.value = None if inner.entry is None else (*inner.path, inner.entry)
        elif word in ("]", "}"):
            if len(self._opened) > 1:
                self._opened.pop()
        elif inner.value is not None:
            self.lines.setdefault(inner.value, line)
            if word == "[":
                self._opened.append(_Open(inner.value, 0, (*inner.value, 0)))
            elif word == "{":
                self._opened.append(_Open(inner.value))
        elif word == "[":
            inner.brackets += 1
        elif word == "=":
            inner.value = self._noted(inner.path, inner.names, line)
        elif word != ".":
            inner.names.append(_key_text(word))

    def _noted(self, path: Key, names: list[str], line: int) -> Key:
        """Note every prefix of a key; step into the last entry of arrays of tables."""
        for index, name in enumerate(names):
            path = (*path, name)
            self.lines.setdefault(path, line)
            if path in self._last and index < len(names) - 1:
                path = (*path, self._last[path])
        return path

    def _header(self, header: _Open, line: int) -> Key:
        """Note the header of a table, or of one more entry of an array; return its path."""
        path = self._noted((), header.names, line)
        if header.brackets == 2:
            self._last[path] = self._last.get(path, -1) + 1
            self.lines[*path, self._last[path]] = line
        return (*path, self._last[path]) if path in self._last else path


def _key_text(word: str) -> str:
    """Return a part of a key without its quotes."""
    if word[0] not in "\"'":
        return word
    try:
        return next(iter(tomllib.loads(f"{word} = 0")))
    except tomllib.TOMLDecodeError:
        return word


def key_lines(text: str) -> dict[Key, int]:
    """Return the line of every key of a valid TOML text."""
    found = _LineMap()
    # the last line may have no end
    for token in _tokens(text + "\n"):
        found.take(*token)
    return found.lines
