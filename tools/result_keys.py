"""Keys of results for the reference page and the JSON schemas, made of the result types."""

from __future__ import annotations

import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Union, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter

from hdbench.records.loads import SequenceEntry
from hdbench.records.quantity import Quantity, TorqueScale
from hdbench.results import RESULT_TYPES
from hdbench.results.dynamic import FilteredTrace
from hdbench.results.parts import Part

_TYPES: Mapping[str, type[Part]] = {**RESULT_TYPES, "filter": FilteredTrace}
KINDS = tuple(_TYPES)
_WORDS = {str: "text", float: "number", int: "integer", bool: "true or false"}
# parts of records that results hold as they are: key, type, unit, meaning
_TABLES: Mapping[object, str] = {
    TorqueScale: """
gain_nm_per_v | uncertain | N m/V | gain
source | text | | where it is from
sha256 | text or null | | SHA-256 of the calibration
calibrated_utc | text or null | | when that was made
age_days | number or null | d | its age at the run
expired | true or false | | whether it was too old
age_words | text | | the same in words
""",
    SequenceEntry: """
kind | text | | zero, preload, load or other event
experiment | text | | experiment
superseded | text | | why it does not count; empty where it does
time_s | number or null | s | when
torque_nm | number or null | N m | load
reading_v | number or null | V | reading
""",
}


@dataclass(frozen=True, slots=True)
class ResultKey:
    """One key of a result.

    Parameters
    ----------
    key : str
        Its name at the top, or ``name[].inner`` of a list's entries, or ``name.inner``.
    type : str
        ``text``, ``number``, ``integer``, ``true or false``, ``list``, ``table``, or ``uncertain``
        (an object with value, std and dof); ``or null`` behind it where there may be none, ``or
        absent`` where the key may be left out.
    unit : str
        Unit of a number; empty for anything else and for ratios.
    meaning : str
        One line.
    """

    key: str
    type: str
    unit: str
    meaning: str


def keys_of(kind: str) -> dict[str, ResultKey]:
    """Return the keys of one kind of result, by name."""
    return {row.key: row for row in _of_type(_TYPES[kind], "")}


def json_schema(kind: str) -> dict[str, Any]:
    """Return the JSON schema of ``hdbench/<kind>/1``."""
    return TypeAdapter(_TYPES[kind]).json_schema()


def _of_table(table: str, prefix: str) -> Iterator[ResultKey]:
    for line in table.strip().splitlines():
        name, kind, unit, meaning = (cell.strip() for cell in line.split("|"))
        yield ResultKey(f"{prefix}{name}", kind, unit, meaning)


def _of_type(part: type[Any], prefix: str) -> Iterator[ResultKey]:
    hints = get_type_hints(part)
    for name, field in part.__pydantic_fields__.items():
        place = f"{prefix}{field.alias or name}"
        words, inside, inner = _described(hints[name])
        if field.exclude_if is not None:
            words = f"{words.removesuffix(' or null')} or absent"
        unit = (field.json_schema_extra or {}).get("unit", "")
        yield ResultKey(place, words, unit, field.description or "")
        if inner in _TABLES:
            yield from _of_table(_TABLES[inner], f"{place}{inside}")
        elif isinstance(inner, type) and issubclass(inner, Part):
            yield from _of_type(inner, f"{place}{inside}")


def _described(hint: Any) -> tuple[str, str, Any]:
    """Return a type in words, what its path goes on with, and what stands inside."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        words, inside, part = _described(next(x for x in inner if x is not type(None)))
        return f"{words} or null", inside, part
    if origin is tuple:
        return "list", "[].", inner[0]
    if origin is dict:
        # entries stand under names of their own, such as that of the experiment
        return "table", ".ID.", inner[1]
    if hint is Quantity:
        return "uncertain", "", None
    return _WORDS.get(hint, "table"), ".", hint
