"""TOML text that may be hostile: read with a place for every refusal, and the line of every key."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdbench.errors import ProfileError

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


def toml_text(path: Path, fix: str) -> str:
    """Read a TOML file as text."""
    where = str(path)
    try:
        if not path.is_file():
            what = "is not a file" if path.exists() else "no such profile"
            raise ProfileError(what, where=where, fix=fix)
        size = path.stat().st_size
        if size > _LIMIT_BYTES:
            raise ProfileError(
                f"{size} bytes; needed: at most {_LIMIT_BYTES}",
                where=where,
                fix="check that this is a profile",
            )
        return _decode(path.read_bytes(), where)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ProfileError(
            f"cannot read: {reason}", where=where, fix="check path and rights"
        ) from error


def _decode(raw: bytes, path: str) -> str:
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ProfileError(
            "not UTF-8 text", where=f"{path}:{line}", fix="save the file as UTF-8"
        ) from error


def read_toml(text: str, path: str) -> dict[str, Any]:
    """Parse TOML text that may be hostile."""
    if len(text) > _LIMIT_BYTES:
        raise ProfileError(
            f"{len(text)} characters; needed: at most {_LIMIT_BYTES}",
            where=path,
            fix="check that this is a profile",
        )
    lines = text.count("\n") + 1
    if lines > _LIMIT_LINES:
        raise ProfileError(
            f"{lines} lines; needed: at most {_LIMIT_LINES}",
            where=path,
            fix="check that this is a profile",
        )
    deep = nesting_problem(text)
    if deep is not None:
        line, what = deep
        raise ProfileError(what, where=f"{path}:{line}", fix="profiles nest three levels at most")
    try:
        return tomllib.loads(text)
    except ValueError as error:
        raise _syntax_error(str(error), text, path) from error


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


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str
    text: str
    line: int


def _tokens(text: str) -> Iterator[_Token]:
    """Yield the tokens of a TOML text up to the first that is none."""
    place, line = 0, 1
    while (match := _TOKEN.match(text, place)) is not None:
        kind, word = str(match.lastgroup), match.group()
        if kind not in ("space", "comment"):
            yield _Token(kind, word, line)
        line += word.count("\n")
        place = match.end()


def nesting_problem(text: str) -> tuple[int, str] | None:
    """Return where a text nests deeper than any profile does, before a parser recurses into it."""
    depth = dots = 0
    for token in _tokens(text):
        if token.text in ("[", "{"):
            depth += 1
        elif token.text in ("]", "}"):
            depth = max(0, depth - 1)
        if token.text == ".":
            dots += 1
        elif token.kind in ("mark", "newline"):
            dots = 0
        if depth > _MAX_DEPTH:
            return token.line, f"brackets nest deeper than {_MAX_DEPTH}"
        if dots > _MAX_PARTS:
            return token.line, f"a key has more than {_MAX_PARTS} parts"
    return None


class _Reader:
    """Walk the tokens of a valid TOML text and note the line of every key."""

    def __init__(self, text: str) -> None:
        self.tokens = list(_tokens(text))
        self.place = 0
        self.lines: dict[Key, int] = {(): 1}
        self.arrays: dict[Key, int] = {}

    def peek(self) -> _Token | None:
        return self.tokens[self.place] if self.place < len(self.tokens) else None

    def take(self, *texts: str) -> bool:
        token = self.peek()
        if token is not None and token.text in texts:
            self.place += 1
            return True
        return False

    def skip_lines(self) -> None:
        while (token := self.peek()) is not None and token.kind == "newline":
            self.place += 1

    def parts(self) -> list[str]:
        """Read a dotted key."""
        names = []
        while (token := self.peek()) is not None and token.kind in ("bare", "string"):
            names.append(_key_text(token))
            self.place += 1
            if not self.take("."):
                break
        return names

    def note(self, base: Key, names: list[str], line: int) -> Key:
        """Note every prefix of a key; step into the last entry of arrays of tables."""
        path = base
        for index, name in enumerate(names):
            path = (*path, name)
            self.lines.setdefault(path, line)
            if path in self.arrays and index < len(names) - 1:
                path = (*path, self.arrays[path])
        return path

    def read(self) -> dict[Key, int]:
        base: Key = ()
        while True:
            self.skip_lines()
            token = self.peek()
            if token is None:
                return self.lines
            before = self.place
            if self.take("["):
                base = self.table(token.line)
            else:
                self.pair(base)
            if self.place == before:
                self.place += 1

    def table(self, line: int) -> Key:
        several = self.take("[")
        path = self.note((), self.parts(), line)
        self.take("]")
        if several:
            self.take("]")
            self.arrays[path] = self.arrays.get(path, -1) + 1
            path = (*path, self.arrays[path])
            self.lines[path] = line
        elif path in self.arrays:
            path = (*path, self.arrays[path])
        return path

    def pair(self, base: Key) -> None:
        token = self.peek()
        names = self.parts()
        if token is not None and names and self.take("="):
            self.value(self.note(base, names, token.line))

    def value(self, path: Key) -> None:
        if self.take("["):
            self.array(path)
        elif self.take("{"):
            while not self.take("}") and self.peek() is not None:
                before = self.place
                self.pair(path)
                self.take(",")
                if self.place == before:
                    return
        else:
            while (token := self.peek()) is not None:
                if token.kind == "newline" or token.text in (",", "]", "}"):
                    return
                self.place += 1

    def array(self, path: Key) -> None:
        index = 0
        while True:
            self.skip_lines()
            token = self.peek()
            if token is None or self.take("]"):
                return
            before = self.place
            self.lines[(*path, index)] = token.line
            self.value((*path, index))
            self.skip_lines()
            self.take(",")
            index += 1
            if self.place == before:
                return


def _key_text(token: _Token) -> str:
    if token.kind == "bare":
        return token.text
    try:
        return next(iter(tomllib.loads(f"{token.text} = 0")))
    except tomllib.TOMLDecodeError:
        return token.text


def key_lines(text: str) -> dict[Key, int]:
    """Return the line of every key of a valid TOML text."""
    return _Reader(text).read()
