"""A profile to start from, and the schema for editors."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from hdbench.errors import ProfileError
from hdbench.profile.loader import load_profile
from hdbench.profile.schema import Name, ProfileData

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


def _value(value: object) -> str:
    if isinstance(value, tuple | list):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return repr(value)


def _comment(field: FieldInfo) -> list[str]:
    text = field.description or ""
    return textwrap.wrap(text, 96, initial_indent="# ", subsequent_indent="# ")


def _table(model: BaseModel, name: str, header: str, reasons: Mapping[str, str]) -> Iterator[str]:
    """Yield the lines of one table: plain keys first, then the tables below it."""
    fields = type(model).model_fields
    below: list[tuple[str, Any]] = []
    if header:
        yield ""
        yield f"# {(type(model).__doc__ or '').strip().splitlines()[0]}"
        yield header
    for key, field in fields.items():
        value = getattr(model, key)
        if isinstance(value, BaseModel) or _tables_in(value):
            below.append((key, value))
            continue
        yield from _comment(field)
        why = reasons.get(f"{name}.{key}")
        line = f"# {key} =" if value is None else f"{key} = {_value(value)}"
        yield f"{line}  # {why}" if why else line
    for key, value in below:
        path = f"{name}.{key}" if name else key
        if isinstance(value, BaseModel):
            yield from _table(value, path, f"[{path}]", reasons)
        else:
            for item in value:
                yield from _table(item, path, f"[[{path}]]", reasons)


def _tables_in(value: object) -> bool:
    return isinstance(value, tuple) and bool(value) and isinstance(value[0], BaseModel)


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
    try:
        TypeAdapter(Name).validate_python(name)
    except ValidationError as error:
        raise ProfileError(
            f"name {name!r:.80}; needed: small letters, digits, '.', '_' and '-', at most 64",
            where="name of the new profile",
            fix="choose another name",
        ) from error
    start = load_profile(_START).data
    changes: Mapping[str, Any] = {"name": name, "description": f"bench {name}"}
    what = f"Every value is still that of {_START}: go through them one by one."
    if filled:
        what = f"What bears no reason is still that of {_START}: go through it."
    lines = [
        f"# A new bench. {what}",
        "# Units stand in the key names; 'hdbench profile check FILE' checks this file.",
        *_table(
            _changed(start, filled or {}).model_copy(update=changes),
            "",
            "",
            {key: why for key, (_, why) in (filled or {}).items()},
        ),
    ]
    return "\n".join(lines) + "\n"


def _changed(start: ProfileData, filled: Mapping[str, tuple[Any, str]]) -> ProfileData:
    """Return a profile with other values."""
    body = start.model_dump()
    for key, (value, _) in filled.items():
        *tables, last = key.split(".")
        table = body
        for part in tables:
            table = table[part]
        table[last] = value
    try:
        return ProfileData.model_validate(body)
    except ValidationError as error:
        first = error.errors()[0]
        raise ProfileError(
            f"{'.'.join(map(str, first['loc']))}: {first['msg']}; found {first['input']!r:.60}",
            where="values of the new profile",
            fix="give another value",
        ) from error
