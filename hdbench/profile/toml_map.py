"""Where each key of a TOML text stands, and a cheap guard before it is parsed."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass

__all__ = ["Key", "key_lines", "nesting_problem"]

Key = tuple[str | int, ...]

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
