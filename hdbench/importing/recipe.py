"""A mapping that is kept as a TOML file and applied to many logs."""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from hdbench.errors import DataError, UsageError
from hdbench.importing.layout import Logger
from hdbench.records.csvtext import read_text
from hdbench.records.loads import LOADS_COLUMNS, LOADS_OPTIONAL
from hdbench.records.storage import write_new
from hdbench.records.tracefile import TRACE_COLUMNS
from hdbench.results import Part

_COLUMNS = {"trace": TRACE_COLUMNS, "loads": (*LOADS_COLUMNS, *LOADS_OPTIONAL)}
_DELIMITERS = {"auto": None, "comma": ",", "semicolon": ";", "tab": "\t", "blank": " "}
_Flag = Annotated[bool, Field(strict=True)]
_Rate = Annotated[float | None, Field(strict=True, gt=0.0, lt=1e300)]
_EXAMPLES = {"--map": "torque_nm=Torque*0.001", "--set": "2:series=down"}
_TARGET = re.compile(r"(?:(?P<file>[1-9]\d{0,3}):)?(?P<target>[a-z][a-z0-9_]*)=(?P<rest>.+)")


def known_columns(kind: str) -> tuple[str, ...]:
    """Return the column names of the contract for ``trace`` or ``loads``."""
    return _COLUMNS[kind]


@dataclass(frozen=True, slots=True)
class Entry:
    """One ``--map`` or ``--set``: where a column comes from, or the value in every row."""

    target: str  # column name of the contract
    # the value, or `COLUMN`, `COLUMN*SCALE`, `COLUMN/SCALE`, each with `+OFFSET` or `-OFFSET`,
    # and declared conversions behind it: `COLUMN@deg@wrapped`
    text: str
    file: int | None = None  # number of the file, from 1, that it is about; None for all


def parse_entry(option: str, text: str, known: Sequence[str]) -> Entry:
    """Parse ``[FILE_NUMBER:]NAME=...`` of ``--map`` or ``--set``."""
    match = _TARGET.fullmatch(text)
    if match is None:
        raise UsageError(
            f"found {text!r:.80}; needed: [FILE_NUMBER:]NAME=...",
            where=option,
            fix=f"such as {option} {_EXAMPLES[option]}",
        )
    target = match["target"]
    near = difflib.get_close_matches(target, known, n=1, cutoff=0.75)
    if target not in known and near:
        raise UsageError(f"no column {target!r}", where=option, fix=f"did you mean {near[0]!r}?")
    return Entry(target, match["rest"], int(match["file"]) if match["file"] else None)


class Recipe(Part, kw_only=False, closed=True):
    """How a log is imported: the options of ``hdbench import``, by name.

    The types are those of a TOML file; each says what it needs.
    """

    kind: Literal["trace", "loads"] = "trace"
    map: Mapping[str, str] = Field(default_factory=dict)
    set: Mapping[str, str] = Field(default_factory=dict)
    topic: str | None = None
    joint: str | None = None
    side: Literal["motor", "output"] = "motor"
    rate_hz: _Rate = None
    torque_constant_nm_per_a: Annotated[float | None, Field(strict=True)] = None
    velocity_from_angle_hz: _Rate = None
    keep_time: _Flag = False
    delimiter: Literal["auto", "comma", "semicolon", "tab", "blank"] = "auto"
    # data logger that wrote the file, or `auto`: a column of time has to be there, and units that
    # are stated are turned into ours
    from_logger: Logger | None = None
    # lines that are passed over before the table is looked for
    skip: Annotated[int, Field(strict=True, ge=0)] = 0
    # whether no rows of names stand above the data
    no_header: _Flag = False

    def changed(self) -> dict[str, Any]:
        """Return what differs from the defaults."""
        plain = Recipe()
        now = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: value for name, value in now.items() if value != getattr(plain, name)}

    def over(self, other: Recipe) -> Recipe:
        """Return another recipe with what is said here in its place."""
        return replace(other, **self.changed())

    def options(self) -> list[str]:
        """Return the recipe as words of a command."""
        words: list[str] = []
        for name, value in self.changed().items():
            if name in ("map", "set"):
                words += [w for n, text in value.items() for w in (f"--{name}", f"{n}={text}")]
            else:
                option = "--" + re.sub("_(hz|nm_per_a)$", "", name).replace("_", "-")
                words += [option, *([] if value is True else [str(value)])]
        return words

    def entries(self, name: Literal["map", "set"]) -> list[Entry]:
        """Return where columns come from, or the columns with one value."""
        option, texts, known = f"--{name}", getattr(self, name), _COLUMNS[self.kind]
        return [parse_entry(option, f"{target}={text}", known) for target, text in texts.items()]

    @property
    def mark(self) -> str | None:
        """Character between columns; None finds it."""
        return _DELIMITERS[self.delimiter]


def read_recipe(path: Path) -> Recipe:
    """Read a recipe."""
    try:
        body = tomllib.loads(read_text(path, "recipe"))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DataError(
            f"not valid TOML: {error}", where=str(path), fix="correct it, or make it again by --map"
        ) from error
    return Recipe.from_json(body, str(path), "correct it")


def write_recipe(path: Path, recipe: Recipe) -> None:
    """Keep a recipe as a new TOML file."""
    lines = ["# hdbench import FILE... --recipe THIS --out FILE|FOLDER"]
    tables = []
    for name, value in recipe.changed().items():
        if name in ("map", "set"):
            tables += ["", f"[{name}]"]
            tables += [f"{_toml(key)} = {_toml(text)}" for key, text in value.items()]
        else:
            lines.append(f"{name} = {_toml(value)}")
    write_new(path, ("\n".join([*lines, *tables]) + "\n").encode())


def _toml(value: object) -> str:
    # what JSON makes of a text, a number or a truth value is TOML too
    return json.dumps(value, ensure_ascii=False)
