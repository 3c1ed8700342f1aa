"""Profiles: read, checked key by key, written as a template."""

from __future__ import annotations

import difflib
import hashlib
import json
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, time
from functools import cached_property
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from hdbench.errors import ProfileError
from hdbench.profile.acquiring import Acquisition, NodeAcquisition, driver_table
from hdbench.profile.schema import ProfileData
from hdbench.profile.tables import CONFLICT, Conflict
from hdbench.profile.toml_text import Key, key_lines, read_toml, toml_text, tuples

_TYPES = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text in quotes",
    "bool_type": "true or false",
    "tuple_type": "a list in [ ]",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "string_pattern_mismatch": "text of another form",
}
_BOUNDS = {
    "greater_than": ("gt", "a number above"),
    "greater_than_equal": ("ge", "a number of at least"),
    "less_than": ("lt", "a number below"),
    "less_than_equal": ("le", "a number of at most"),
}


def key_text(key: Key) -> str:
    """Return a key as a person writes it, such as ``model.ripple[0].order``."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text or "the profile"


@dataclass(frozen=True)
class TomlFile:
    """A TOML text that is refused: its problems name file, line and key."""

    path: str
    text: str

    @cached_property
    def _lines(self) -> Mapping[Key, int]:
        return key_lines(self.text)

    def problem(self, key: Key, what: str, fix: str) -> ProfileError:
        """Return one problem at one key; at the table around it where it does not stand there."""
        known = key
        while known and known not in self._lines:
            known = known[:-1]
        where = f"{self.path}:{self._lines.get(known, 1)}"
        return ProfileError(f"key {key_text(key)!r}: {what}", where=where, fix=fix)

    def finding(
        self, key: Key, error: Mapping[str, Any], known: Iterable[str], help_text: str
    ) -> ProfileError:
        """Return one finding of pydantic in a file that is no profile."""
        if error["type"] == "missing":
            return self.problem(key, "missing", f"add {key[-1]} = ... ({help_text})")
        if error["type"] == "extra_forbidden":
            near = difflib.get_close_matches(str(key[-1]), known, n=1)
            fix = f"did you mean {near[0]!r}?" if near else f"take it out ({help_text})"
            return self.problem(key, "unknown", fix)
        return self.problem(key, said(error), f"correct the value ({help_text})")


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((m for arg in get_args(annotation) if (m := _model_in(arg)) is not None), None)


def _model_at(key: Key) -> type[BaseModel] | None:
    """Return the table at a place in the profile, None where there is none."""
    model: type[BaseModel] | None = ProfileData
    for part in key:
        if model is None or isinstance(part, int):
            continue
        field = model.model_fields.get(part)
        model = driver_table(part) or (None if field is None else _model_in(field.annotation))
    return model


def _meaning(key: Key) -> str:
    """Return what a key means; of an entry of a list what the list means."""
    while key and isinstance(key[-1], int):
        key = key[:-1]
    model = _model_at(key[:-1]) if key else None
    field = None if model is None else model.model_fields.get(str(key[-1]))
    return (field.description if field else None) or "see 'hdbench profile schema'"


def known_keys(root: type[BaseModel], base: Key = ()) -> Iterator[Key]:
    """Yield the path of every key that a model knows."""
    for name, field in root.model_fields.items():
        yield (*base, name)
        below = _model_in(field.annotation)
        if below is Acquisition:
            below = NodeAcquisition
        if below is not None:
            yield from known_keys(below, (*base, name))


def _nearest(tagged: Key, key: Key) -> str:
    """Return the fix for an unknown key: the nearest one that exists."""
    model = _model_at(tagged[:-1])
    siblings = list(model.model_fields) if model is not None else []
    everywhere: dict[str, str] = {}
    for path in known_keys(ProfileData):
        everywhere.setdefault(str(path[-1]), key_text(path))
    beside = {name: key_text((*key[:-1], name)) for name in siblings}
    for known, more in ((beside, ""), (everywhere, " else take the key out")):
        for near in difflib.get_close_matches(str(key[-1]), known, n=1):
            return f"did you mean {known[near]!r}?{more}"
    return f"take it out; known here: {', '.join(siblings)}" if siblings else "take it out"


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple):
        return f"a list of {len(value)}"
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, date | time):
        return value.isoformat()
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _needed(error: Mapping[str, Any]) -> str:
    kind = str(error["type"])
    if kind in _BOUNDS:
        name, words = _BOUNDS[kind]
        return f"{words} {error['ctx'][name]}"
    if kind == "too_short":
        return f"at least {error['ctx']['min_length']} entries"
    return _TYPES.get(kind) or str(error["msg"]).removeprefix("Input should be ")


def said_elsewhere(error: Mapping[str, Any]) -> bool:
    """Return whether a list counts as short only because entries that are wrong do not count."""
    return error["type"] == "too_short" and len(error["input"]) >= int(error["ctx"]["min_length"])


def schema_problems(file: TomlFile, error: Mapping[str, Any]) -> list[ProfileError]:
    """Return one finding of pydantic as problems with file, line, key, found and needed."""
    tagged: Key = tuple(error["loc"])
    # the table of a driver stands in the location, but not in the file
    key = tuple(part for part in tagged if driver_table(part) is None)
    kind = error["type"]
    if kind == CONFLICT:
        found: list[Conflict] = error["ctx"]["conflicts"]
        return [file.problem((*key, *c.key), c.what, c.fix) for c in found]
    if said_elsewhere(error):
        return []
    fix = f"correct the value of {key_text(key)}"
    if kind == "extra_forbidden":
        what, fix = "unknown", _nearest(tagged, key)
    elif kind == "missing":
        what = f"missing; needed: {_meaning(tagged)}"
        fix = f"add '{key[-1]} = ...' to {key_text(key[:-1])}" if key else "fill the profile"
    else:
        what = f"found {_shown(error['input'])}; needed: {_needed(error)} ({_meaning(tagged)})"
    return [file.problem(key, what, fix)]


def said(error: Mapping[str, Any]) -> str:
    """Return what pydantic says of a value, with the value where it does not name it."""
    words = str(error["msg"]).removeprefix("Value error, ")
    if isinstance(error["input"], dict) or error["type"] == "value_error":
        return words
    return f"found {error['input']!r}; {words}"


def _profiles() -> Traversable:
    return resources.files("hdbench_profiles")


@dataclass(frozen=True, slots=True)
class Profile:
    """A checked profile and the text that it came from.

    Parameters
    ----------
    data : ProfileData
        The bench.
    text : str
        TOML text.
    sha256 : str
        SHA-256 of that text in UTF-8.
    path : str
        Where it was read.
    drive : str
        Which drive is on the bench: ``identity.drive_serial``, or what was told beside the profile;
        empty where nobody says.
    """

    data: ProfileData
    text: str
    sha256: str
    path: str
    drive: str = ""

    @property
    def name(self) -> str:
        """Name of the profile."""
        return self.data.name

    @property
    def sensor(self) -> str:
        """Serial number of the flexspline, which carries the gauges; empty where nobody says."""
        return self.data.identity.flexspline_serial

    def describe(self) -> dict[str, str]:
        """Return ``name`` and ``sha256`` as results hold them."""
        return {"name": self.name, "sha256": self.sha256}


def list_profiles() -> tuple[str, ...]:
    """Return the names of the built-in profiles, sorted.

    Returns
    -------
    tuple of str
    """
    return named_files(_profiles())


def named_files(folder: Traversable) -> tuple[str, ...]:
    """Return the names of the TOML files in a folder of the package, sorted."""
    files = (file.name for file in folder.iterdir())
    return tuple(sorted(name[:-5] for name in files if name.endswith(".toml")))


def named_text(name_or_path: str, folder: Traversable, what: str) -> tuple[str, str]:
    """Return text and place of a file of the package by its name, or of any file by its path."""
    names = named_files(folder)
    if name_or_path in names:
        resource = folder / f"{name_or_path}.toml"
        return resource.read_text(encoding="utf-8"), str(resource)
    path = Path(name_or_path)
    near = difflib.get_close_matches(path.stem, names, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    fix = f"{hint}name a TOML file or a built-in {what}: {', '.join(names)}"
    return toml_text(path, fix, what), str(path)


def load_profile(name_or_path: str) -> Profile:
    """Load a built-in profile by name, or any profile by path.

    Parameters
    ----------
    name_or_path : str
        A built-in name, such as ``cim-tr-97-06``, or the path of a TOML file.

    Returns
    -------
    Profile

    Raises
    ------
    ProfileError
        If there is no such profile, or it is invalid; then ``problems`` holds every problem.
    """
    return parse_profile(*named_text(name_or_path, _profiles(), "profile"))


def check_profiles(names: Sequence[str]) -> tuple[Profile, ...]:
    """Load several profiles and name the problems of all of them at once.

    Parameters
    ----------
    names : sequence of str
        As for `load_profile`.

    Returns
    -------
    tuple of Profile

    Raises
    ------
    ProfileError
        If any of them is invalid; ``problems`` holds every problem of every one.
    """
    profiles, errors = [], []
    for name in names:
        try:
            profiles.append(load_profile(name))
        except ProfileError as error:
            errors.append(error)
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise ProfileError(
            f"{len(errors)} of {len(names)} profiles are invalid",
            where=", ".join(error.where for error in errors),
            fix="correct each of them",
            problems=tuple(p for error in errors for p in error.problems or (error,)),
        )
    return tuple(profiles)


def profile_from_json(text: str) -> ProfileData:
    """Return the profile that another process has written as JSON.

    JSON has lists where a profile has tuples, and a table that fills in keys before it is checked
    (a composite) is then checked strictly.
    """
    return ProfileData.model_validate(tuples(json.loads(text)))


def parse_profile(text: str, path: str) -> Profile:
    """Check the text of a profile.

    Parameters
    ----------
    text : str
        TOML text.
    path : str
        Where it came from, for messages.

    Returns
    -------
    Profile

    Raises
    ------
    ProfileError
        If anything is wrong. ``problems`` holds every problem at once, in the order of the lines,
        each with file and line, key, what was found and what is needed with its unit.
    """
    data = _checked(tuples(read_toml(text, path)), path, text)
    digest = hashlib.sha256(text.encode()).hexdigest()
    return Profile(data, text, digest, path, data.identity.drive_serial)


def stored_profile(manifest: Mapping[str, Any], run: Path) -> Profile | None:
    """Return the profile that a run was made with.

    Parameters
    ----------
    manifest : mapping
        Content of its ``run.json``.
    run : Path
        Its folder, for messages.

    Returns
    -------
    Profile or None
        None where the run holds none.

    Raises
    ------
    ProfileError
        If the profile is invalid.
    """
    stored = manifest.get("profile")
    text = stored.get("text") if isinstance(stored, Mapping) else None
    return parse_profile(text, f"{run / 'run.json'}: profile") if isinstance(text, str) else None


def _checked(body: dict[str, Any], path: str, text: str = "") -> ProfileData:
    """Return a profile, or raise all that is wrong with it."""
    try:
        return ProfileData.model_validate(body)
    except ValidationError as error:
        file, entries = TomlFile(path, text), error.errors(include_url=False)
        found = [one for entry in entries for one in schema_problems(file, entry)]
        raise all_problems(path, found) from error


def check_loads(profile: Profile) -> None:
    """Refuse a profile whose weights exceed its torque limit.

    Parameters
    ----------
    profile : Profile
        The bench on which weights are to hang; what hangs none needs no such check.

    Raises
    ------
    ProfileError
        With file, line and key of each list of weights that is too heavy.
    """
    file = TomlFile(profile.path, profile.text)
    found = [file.problem(c.key, c.what, c.fix) for c in profile.data.load_conflicts()]
    if found:
        raise all_problems(profile.path, found)


def all_problems(path: str, found: list[ProfileError]) -> ProfileError:
    """Return one error that names every problem of a file, in the order of its lines."""
    found.sort(key=lambda error: int(error.where.rpartition(":")[2]))
    count = f"{len(found)} problems" if len(found) != 1 else "1 problem"
    return ProfileError(
        f"{count}: " + "; ".join(error.what for error in found[:5]),
        where=path,
        fix=found[0].fix if len(found) == 1 else "correct each of them",
        problems=tuple(found),
    )


_START = "cim-tr-97-06"


def profile_schema() -> dict[str, Any]:
    """Return the JSON schema of a profile; descriptions hold meaning and unit of each key.

    Returns
    -------
    dict
        JSON Schema, draft 2020-12.
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **ProfileData.model_json_schema(),
    }


def _table(model: BaseModel, name: str, header: str, reasons: Mapping[str, str]) -> Iterator[str]:
    """Yield the lines of one table: plain keys first, then the tables below it."""
    below: list[tuple[str, str, BaseModel]] = []
    if header:
        yield ""
        yield f"# {(type(model).__doc__ or '').strip().splitlines()[0]}"
        yield header
    for key, field in type(model).model_fields.items():
        value, path = getattr(model, key), f"{name}.{key}" if name else key
        if isinstance(value, BaseModel):
            below.append((path, f"[{path}]", value))
        elif isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
            below += [(path, f"[[{path}]]", entry) for entry in value]
        else:
            text = field.description or ""
            yield from textwrap.wrap(text, 96, initial_indent="# ", subsequent_indent="# ")
            # numbers, truth values, text and lists of them are written in JSON as in TOML
            text = json.dumps(value, ensure_ascii=False)
            line = f"# {key} =" if value is None else f"{key} = {text}"
            yield f"{line}  # {reasons[path]}" if reasons.get(path) else line
    for path, title, table in below:
        yield from _table(table, path, title, reasons)


def new_profile(name: str, filled: Mapping[str, tuple[Any, str]] | None = None) -> str:
    """Return the text of a new profile, with the meaning and unit of every key in a comment.

    Parameters
    ----------
    name : str
        Name of the new bench: small letters, digits, ``.``, ``_``, ``-``; at most 64.
    filled : mapping of str to tuple of (value, str), optional
        Values that are known, by their dotted key, and where each comes from.

    Returns
    -------
    str
        TOML text; what is not filled has the value of the report's bench.

    Raises
    ------
    ProfileError
        If `name` is not such a name, or a value is outside of its domain.
    """
    body = load_profile(_START).data.model_dump()
    body |= {"name": name, "description": f"bench {name}"}
    for key, (value, _) in (filled or {}).items():
        *tables, last = key.split(".")
        table = body
        for part in tables:
            table = table[part]
        table[last] = value
    data = _checked(body, "the new profile")
    what = f"Every value is still that of {_START}: go through them one by one."
    if filled:
        what = f"What bears no reason is still that of {_START}: go through it."
    lines = [
        f"# A new bench. {what}",
        "# Units stand in the key names; 'hdbench profile check FILE' checks this file.",
        *_table(data, "", "", {key: why for key, (_, why) in (filled or {}).items()}),
    ]
    return "\n".join(lines) + "\n"
