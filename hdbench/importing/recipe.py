"""A mapping that is kept as a TOML file and applied to many logs."""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from hdbench.errors import DataError
from hdbench.importing.layout import ForeignFormat
from hdbench.importing.mapping import Entry, parse_constant, parse_map
from hdbench.importing.source import Asked
from hdbench.records.loads import LOADS_COLUMNS, LOADS_OPTIONAL
from hdbench.records.storage import write_new
from hdbench.records.tables import TRACE_COLUMNS, read_text

_COLUMNS = {"trace": TRACE_COLUMNS, "loads": (*LOADS_COLUMNS, *LOADS_OPTIONAL)}
DELIMITERS = {"auto": None, "comma": ",", "semicolon": ";", "tab": "\t", "blank": " "}
_CHOICES: dict[str, tuple[str, ...]] = {
    "kind": ("trace", "loads"),
    "side": ("motor", "output"),
    "delimiter": tuple(DELIMITERS),
    "from_logger": ("auto", "labjack", "dataq"),
}


def known_columns(kind: str) -> tuple[str, ...]:
    """Return the column names of the contract for ``trace`` or ``loads``."""
    return _COLUMNS[kind]


@dataclass(frozen=True, slots=True)
class Recipe:
    """How a log is imported: the options of ``hdbench import``, by name.

    Parameters
    ----------
    kind : str
        ``trace`` or ``loads``.
    map, set : mapping of str to str
        As ``--map NAME=...`` and ``--set NAME=...``.
    topic, joint : str or None
        Which channels are looked at.
    side : str
        ``output`` where angles and velocities are those of the joint.
    rate_hz : float or None
        Sample rate where there is no time, Hz.
    torque_constant_nm_per_a : float or None
        Torque per current, N m/A.
    velocity_from_angle_hz : float or None
        Cutoff of the derivative of the angle, Hz.
    keep_time : bool
        Keep the time as it is.
    delimiter, from_logger : str or None
        Layout of a text.
    skip : int
        Lines before the table.
    no_header : bool
        Whether there is no row of names.
    """

    kind: str = "trace"
    map: Mapping[str, str] = field(default_factory=dict)
    set: Mapping[str, str] = field(default_factory=dict)
    topic: str | None = None
    joint: str | None = None
    side: str = "motor"
    rate_hz: float | None = None
    torque_constant_nm_per_a: float | None = None
    velocity_from_angle_hz: float | None = None
    keep_time: bool = False
    delimiter: str = "auto"
    from_logger: str | None = None
    skip: int = 0
    no_header: bool = False

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
            elif name == "kind":
                words += ["--kind", value]
            else:
                option = "--" + re.sub("_(hz|nm_per_a)$", "", name).replace("_", "-")
                words += [option, *([] if value is True else [str(value)])]
        return words

    def maps(self) -> list[Entry]:
        """Return where columns come from."""
        return [parse_map(f"{n}={text}", _COLUMNS[self.kind]) for n, text in self.map.items()]

    def constants(self) -> list[Entry]:
        """Return the columns with one value."""
        return [parse_constant(f"{n}={text}", _COLUMNS[self.kind]) for n, text in self.set.items()]

    @property
    def layout(self) -> ForeignFormat:
        """Layout of a text."""
        logger: Any = self.from_logger
        mark = DELIMITERS[self.delimiter]
        return ForeignFormat(mark, not self.no_header, self.skip, logger)

    @property
    def asked(self) -> Asked:
        """Topic and joint."""
        return Asked(self.topic, self.joint)


def _bad(path: Path, key: str, what: str, fix: str) -> DataError:
    return DataError(f"key {key!r:.60} {what}", where=f"{path}: {key:.60}", fix=fix)


def read_recipe(path: Path) -> Recipe:
    """Read a recipe."""
    try:
        body = tomllib.loads(read_text(path, "recipe"))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DataError(
            f"not valid TOML: {error}", where=str(path), fix="correct it, or make it again by --map"
        ) from error
    plain = Recipe()
    known = {f.name: getattr(plain, f.name) for f in fields(plain)}
    for key, value in body.items():
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
            raise _bad(path, key, "is not known", hint)
        _check_value(path, key, value)
    numbers = {k: float(v) for k, v in body.items() if k.endswith(("_hz", "_a"))}
    return replace(plain, **{**body, **numbers})


def _check_value(path: Path, key: str, value: object) -> None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if key in ("map", "set"):
        good = isinstance(value, dict) and all(isinstance(v, str) for v in value.values())
        needed = f'a table of texts, such as [{key}] torque_nm = "Torque"'
    elif key in _CHOICES:
        good, needed = value in _CHOICES[key], " or ".join(_CHOICES[key])
    elif key in ("keep_time", "no_header"):
        good, needed = isinstance(value, bool), "true or false"
    elif key == "skip":
        good, needed = is_number and isinstance(value, int) and value >= 0, "a whole number"
    elif key in ("topic", "joint"):
        good, needed = isinstance(value, str), "a text in quotes"
    else:
        least = 0.0 if key.endswith("_hz") else -1e300
        good = is_number and least < float(str(value)) < 1e300
        needed = "a number" if least else "a number, more than 0"
    if not good:
        raise _bad(path, key, f"is {value!r:.40}; needed: {needed}", "correct it")


def write_recipe(path: Path, recipe: Recipe) -> None:
    """Keep a recipe as a new TOML file."""
    lines = ["# hdbench import FILE... --recipe THIS --out FILE|FOLDER"]
    tables = []
    for name, value in recipe.changed().items():
        if name in ("map", "set"):
            tables += ["", f"[{name}]"]
            tables += [f"{json.dumps(key)} = {_toml(text)}" for key, text in value.items()]
        else:
            lines.append(f"{name} = {_toml(value)}")
    write_new(path, ("\n".join([*lines, *tables]) + "\n").encode())


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    # a text of JSON is one of TOML too
    return json.dumps(value, ensure_ascii=False)
