"""Causes files (TOML) and declarations in model files, with errors that name the place."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, TypeAdapter, ValidationError

from hdbench.errors import DataError, ProfileError
from hdbench.model import declared
from hdbench.model.causes import ALL_CAUSES
from hdbench.model.definition import Cause
from hdbench.profile import loader
from hdbench.profile.toml_text import Key, read_toml, toml_text, tuples

_HELP = "docs/causes.md lists keys, units and domains"
_SPECS: Mapping[str, type[BaseModel]] = {
    "harmonics": declared.HarmonicsSpec,
    "tone": declared.ToneSpec,
    "polynomial": declared.PolynomialSpec,
    "table": declared.TableSpec,
}


def load_causes(path: Path) -> tuple[Cause, ...]:
    """Read a causes file.

    Parameters
    ----------
    path : Path
        A TOML file as ``docs/causes.md`` describes it.

    Returns
    -------
    tuple of Cause
        In order of the file.

    Raises
    ------
    DataError
        If the file is missing or no TOML, a key is unknown, missing or out of its domain, a name
        stands twice or is one of the catalogue. ``problems`` holds every problem with file and
        line.
    """
    text = toml_text(path, "name a TOML file of causes")
    raw = tuples(read_toml(text, str(path)))
    file = loader.TomlFile(str(path), text)
    try:
        specs = declared.CauseFile.model_validate(raw).cause
    except ValidationError as error:
        entries = [e for e in error.errors(include_url=False) if not loader.said_elsewhere(e)]
        raise _all_problems(file.path, [_entry(file, entry) for entry in entries]) from None
    found = list(_taken(file, specs))
    if not specs:
        found = [file.problem(("cause",), "holds no cause", f"add one ({_HELP})")]
    if found:
        raise _all_problems(file.path, found)
    return tuple(declared.cause_of(spec) for spec in specs)


def declared_cause(definition: Mapping[str, Any], *, where: str) -> Cause:
    """Return the cause of a declaration that a model file holds."""
    adapter: TypeAdapter[declared.Spec] = TypeAdapter(declared.Declaration)
    try:
        return declared.cause_of(adapter.validate_python(tuples(dict(definition))))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = loader.key_text(_key(first))
        raise DataError(
            f"key {key!r}: {loader.said(first)}",
            where=where,
            fix=f"correct the declaration ({_HELP})",
        ) from None


def _key(error: Mapping[str, Any]) -> Key:
    """Return the key of a finding; pydantic puts the kind of a cause into its path."""
    return tuple(part for part in error["loc"] if part not in _SPECS)


def _entry(file: loader.TomlFile, error: Mapping[str, Any]) -> ProfileError:
    """Return one finding of pydantic with file, line and key."""
    key, kind = _key(error), str(error["type"])
    if kind == "union_tag_not_found":
        fix = f"add kind = ..., one of {', '.join(_SPECS)} ({_HELP})"
        return file.problem((*key, "kind"), "missing", fix)
    if kind == "union_tag_invalid":
        words = f"found {error['input'].get('kind')!r}; needed: one of {', '.join(_SPECS)}"
        return file.problem((*key, "kind"), words, f"correct the value ({_HELP})")
    spec = next((_SPECS[part] for part in error["loc"] if part in _SPECS), declared.CauseFile)
    return file.finding(key, error, spec.model_fields, _HELP)


def _taken(file: loader.TomlFile, specs: Sequence[declared.Spec]) -> Iterator[ProfileError]:
    """Yield one problem for every name that is taken and every look-alike that does not exist."""
    catalogue = {cause.name for cause in ALL_CAUSES}
    seen = set(catalogue)
    known = catalogue | {spec.name for spec in specs}
    for place, spec in enumerate(specs):
        if spec.name in seen:
            owner = "the catalogue" if spec.name in catalogue else "a cause above it"
            what = f"{spec.name!r} is a name of {owner}; needed: a name of its own"
            yield file.problem(("cause", place, "name"), what, "choose another name")
        seen.add(spec.name)
        for name in spec.look_alikes:
            if name not in known:
                near = difflib.get_close_matches(name, known, n=1, cutoff=0.0)[0]
                key = ("cause", place, "look_alikes")
                yield file.problem(key, f"unknown cause {name!r}", f"write {near!r}")


def _all_problems(path: str, found: list[ProfileError]) -> DataError:
    whole = found[0] if len(found) == 1 else loader.all_problems(path, found)
    return DataError(whole.what, where=whole.where, fix=whole.fix, problems=whole.problems)
