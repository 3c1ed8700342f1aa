"""TOML text that may be hostile, read with a place for every refusal."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from hdbench.errors import ProfileError
from hdbench.profile.toml_map import nesting_problem

__all__ = ["read_toml", "toml_text"]

# the built-in profile has 8 kB in 150 lines; a parser takes seconds for a megabyte of brackets
_LIMIT_BYTES = 256_000
_LIMIT_LINES = 10_000
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
