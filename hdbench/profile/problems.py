"""Problems of a profile: errors of pydantic in the words of a user who edits it."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from datetime import date, time
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from hdbench.errors import ProfileError
from hdbench.profile.acquiring import Acquisition, NodeAcquisition, driver_table
from hdbench.profile.tables import CONFLICT, Conflict
from hdbench.profile.toml_text import Key

_TYPES = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text in quotes",
    "bool_type": "true or false",
    "tuple_type": "a list in [ ]",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "finite_number": "a finite number",
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


def _line(lines: Mapping[Key, int], key: Key) -> int:
    while key and key not in lines:
        key = key[:-1]
    return lines.get(key, 1)


def problem(path: str, lines: Mapping[Key, int], key: Key, what: str, fix: str) -> ProfileError:
    """Return one problem at one key."""
    return ProfileError(
        f"key {key_text(key)!r}: {what}", where=f"{path}:{_line(lines, key)}", fix=fix
    )


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((m for arg in get_args(annotation) if (m := _model_in(arg)) is not None), None)


def _model_at(model: type[BaseModel] | None, key: Key) -> type[BaseModel] | None:
    for part in key:
        if model is None or isinstance(part, int):
            continue
        if driver_table(part) is not None:
            model = driver_table(part)
            continue
        field = model.model_fields.get(part)
        model = None if field is None else _model_in(field.annotation)
    return model


def _field_at(root: type[BaseModel], key: Key) -> FieldInfo | None:
    named = key
    while named and isinstance(named[-1], int):
        named = named[:-1]
    if not named:
        return None
    model = _model_at(root, named[:-1])
    return None if model is None else model.model_fields.get(str(named[-1]))


def known_keys(root: type[BaseModel], base: Key = ()) -> Iterator[Key]:
    """Yield the path of every key that a model knows."""
    for name, field in root.model_fields.items():
        yield (*base, name)
        below = _model_in(field.annotation)
        if below is Acquisition:
            below = NodeAcquisition
        if below is not None:
            yield from known_keys(below, (*base, name))


def _nearest(root: type[BaseModel], key: Key) -> str:
    """Return the fix for an unknown key: the nearest one that exists."""
    name = str(key[-1])
    model = _model_at(root, key[:-1])
    siblings = list(model.model_fields) if model is not None else []
    key = tuple(part for part in key if driver_table(part) is None)
    near = difflib.get_close_matches(name, siblings, n=1, cutoff=0.6)
    if near:
        return f"did you mean {key_text((*key[:-1], near[0]))!r}?"
    everywhere: dict[str, str] = {}
    for path in known_keys(root):
        everywhere.setdefault(str(path[-1]), key_text(path))
    near = difflib.get_close_matches(name, everywhere, n=1, cutoff=0.6)
    if near:
        return f"did you mean {everywhere[near[0]]!r}? else take the key out"
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
    kind, context = str(error["type"]), error.get("ctx", {})
    if kind in _TYPES:
        return _TYPES[kind]
    if kind in _BOUNDS:
        name, words = _BOUNDS[kind]
        return f"{words} {context[name]}"
    if kind == "literal_error":
        return str(context["expected"])
    if kind == "too_short":
        return f"at least {context['min_length']} entries"
    if kind == "string_pattern_mismatch":
        return "text of another form"
    return str(error["msg"])


def schema_problems(
    root: type[BaseModel], path: str, lines: Mapping[Key, int], error: Mapping[str, Any]
) -> list[ProfileError]:
    """Return one finding of pydantic as problems with file, line, key, found and needed."""
    tagged: Key = tuple(error["loc"])
    # the table of a driver stands in the location, but not in the file
    key = tuple(part for part in tagged if driver_table(part) is None)
    if error["type"] == CONFLICT:
        found: list[Conflict] = error["ctx"]["conflicts"]
        return [problem(path, lines, (*key, *c.key), c.what, c.fix) for c in found]
    if error["type"] == "too_short" and len(error["input"]) >= int(error["ctx"]["min_length"]):
        # entries that are wrong themselves are not counted; each of them is named
        return []
    return [_schema_problem(root, path, lines, error, tagged, key)]


def _schema_problem(
    root: type[BaseModel],
    path: str,
    lines: Mapping[Key, int],
    error: Mapping[str, Any],
    tagged: Key,
    key: Key,
) -> ProfileError:
    if error["type"] == "extra_forbidden":
        return problem(path, lines, key, "unknown", _nearest(root, tagged))
    field = _field_at(root, tagged)
    meaning = (field.description if field is not None else None) or "see 'hdbench profile schema'"
    if error["type"] == "missing":
        line = f"add '{key[-1]} = ...' to {key_text(key[:-1])}" if key else "fill the profile"
        return problem(path, lines, key, f"missing; needed: {meaning}", line)
    what = f"found {_shown(error['input'])}; needed: {_needed(error)} ({meaning})"
    return problem(path, lines, key, what, f"correct the value of {key_text(key)}")
