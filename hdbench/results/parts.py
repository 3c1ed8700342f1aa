"""Parts that several results share, how a result becomes JSON, and paths of its keys."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Annotated, Any, ClassVar, Self, dataclass_transform

from pydantic import ConfigDict, Field, PlainSerializer, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass
from pydantic.fields import FieldInfo

from hdbench.errors import DataError
from hdbench.records.quantity import Quantity, TorqueScale

# keys of `Result` that stand before those of a kind; the others stand behind them
_HEAD_KEYS = 3
_CONFIG = ConfigDict(
    allow_inf_nan=False, validate_by_name=True, validate_by_alias=True, defer_build=True
)

_EVALUATE_AGAIN = "evaluate the run again with --from"

# both write whole numbers as whole numbers, as they always stood in the files
Uncertain = Annotated[Quantity, PlainSerializer(Quantity.to_dict)]
Scale = Annotated[TorqueScale, PlainSerializer(TorqueScale.to_dict)]


def key(
    meaning: str,
    unit: str = "",
    *,
    default: Any = ...,
    name: str | None = None,
    absent: bool = False,
) -> Any:
    """Return the field of one key of a result.

    Parameters
    ----------
    meaning : str
        One line.
    unit : str
        Unit of a number; empty for anything else and for ratios.
    default : object
        What stands for the key where a result does not hold it; without it the key is needed.
    name : str or None
        Key in the JSON where it cannot be the attribute's name.
    absent : bool
        Whether the key is left out of the JSON where it is None or empty.
    """
    return Field(
        default,
        description=meaning,
        alias=name,
        json_schema_extra={"unit": unit} if unit else None,
        exclude_if=_is_empty if absent else None,
    )


def optional(meaning: str, unit: str = "", **more: Any) -> Any:
    """Return the field of a key that is None where a result does not hold it."""
    return key(meaning, unit, default=None, **more)


def listed(meaning: str, unit: str = "") -> Any:
    """Return the field of a list that is empty where a result does not hold it."""
    return key(meaning, unit, default=())


def _is_empty(value: object) -> bool:
    return value is None or value == "" or value == ()


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(key,))
class Part:
    """Part of a result, with its JSON: every class made of it is a frozen dataclass."""

    # one for each class: made anew for a call it would build the schema anew
    _adapter: ClassVar[TypeAdapter[Any]]

    def __init_subclass__(
        cls, *, kw_only: bool = True, closed: bool = False, strict: bool = False
    ) -> None:
        config = ConfigDict(**_CONFIG, extra="forbid" if closed else "ignore", strict=strict)
        dataclass(frozen=True, kw_only=kw_only, config=config)(cls)
        cls._adapter = TypeAdapter(cls)

    def to_json(self) -> dict[str, Any]:
        """Return the keys as the JSON file holds them, in its order."""
        body: dict[str, Any] = self._adapter.dump_python(self, mode="json", by_alias=True)
        return body

    @classmethod
    def from_json(cls, body: Any, where: str, fix: str = _EVALUATE_AGAIN) -> Self:
        """Read a stored result; keys that an older version did not write may be missing.

        Parameters
        ----------
        body : mapping
            Content of the file.
        where : str
            The file, for messages.
        fix : str
            What mends a wrong one.

        Raises
        ------
        DataError
            If a key that is needed is missing, or a value is of another type.
        """
        try:
            if cls.__dict__["__pydantic_config__"]["strict"]:
                # of JSON a list is strictly a tuple, too
                part: Self = cls._adapter.validate_json(json.dumps(body))
            else:
                part = cls._adapter.validate_python(body)
        except ValidationError as error:
            place, what = first_fault(error, [field.name for field in fields(cls)])  # type: ignore[arg-type]
            raise DataError(what, where=f"{where}: {place}" if place else where, fix=fix) from error
        return part


def first_fault(error: ValidationError, known: Sequence[str] = ()) -> tuple[str, str]:
    """Return the place of the first wrong key, and what was found and is needed."""
    first = error.errors(include_url=False)[0]
    place, said = ".".join(map(str, first["loc"])), first["msg"]
    needed = said.removeprefix("Input should be ")
    if first["type"] == "missing":
        said = "found nothing; needed: this key"
    elif first["type"] == "unexpected_keyword_argument":
        near = difflib.get_close_matches(str(first["loc"][-1]), known, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        said = f"unknown key; {hint}known: {', '.join(sorted(known))}"
    elif first["type"] == "value_error":
        said = said.removeprefix("Value error, ")
    else:
        said = f"found {first['input']!r:.60}; needed: {needed}"
    return place, said


class DataFlag(Part, kw_only=False):
    """What makes part of a record doubtful, or limits what can be said of it."""

    name: str = key("what was found")
    samples: int = key("samples that it concerns")
    detail: str = key("the same in words")


class ProfileName(Part):
    """Profile that a result was made with."""

    name: str = key("name of the profile")
    sha256: str = key("SHA-256 of its text")


class Result(Part):
    """Keys of every evaluated record."""

    schema: str = key("hdbench/KIND/1")
    hdbench_version: str = key("version that wrote it", default="")
    profile: ProfileName | None = optional("name and SHA-256 of the profile")
    flags: tuple[DataFlag, ...] = listed("what the data show")
    notes: tuple[DataFlag, ...] = listed("what a person should know")
    n_samples: int | None = optional("samples or readings used")
    run: str | None = optional("run that it belongs to", absent=True)
    doubts: tuple[str, ...] = listed("reasons to doubt the data")
    imported: dict[str, Any] | None = optional("where an imported record comes from", absent=True)

    @classmethod
    def from_json(cls, body: Any, where: str, fix: str = _EVALUATE_AGAIN) -> Self:
        """Read a stored result; a part that an older version wrote with fewer keys is left out."""
        try:
            return super().from_json(body, where, fix)
        except DataError as error:
            lacking = cls._lacking(error.__cause__)
            if not lacking:
                raise
        rest = {name: value for name, value in body.items() if name not in lacking}
        notes = [
            DataFlag("older-version", 0, f"{part} is left out: it lacks {place}").to_json()
            for part, place in lacking.items()
        ]
        return super().from_json({**rest, "notes": [*rest.get("notes", ()), *notes]}, where, fix)

    @classmethod
    def _lacking(cls, error: BaseException | None) -> dict[str, str]:
        """Return parts that a result may do without, each with a key that it lacks.

        Empty where anything else is wrong, too.
        """
        every: dict[str, FieldInfo] = vars(cls)["__pydantic_fields__"]
        spare = {info.alias or name for name, info in every.items() if not info.is_required()}
        lacking: dict[str, str] = {}
        for fault in error.errors(include_url=False) if isinstance(error, ValidationError) else ():
            place = [str(step) for step in fault["loc"]]
            if fault["type"] != "missing" or len(place) < 2 or place[0] not in spare:
                return {}
            lacking.setdefault(place[0], ".".join(place))
        return lacking

    def to_json(self) -> dict[str, Any]:
        """Return the keys as the JSON file holds them: what all kinds share at its two ends."""
        body = Part.to_json(self)
        last = [field.name for field in fields(Result)][_HEAD_KEYS:]
        middle = {name: value for name, value in body.items() if name not in last}
        return middle | {name: body[name] for name in last if name in body}


Leaf = float | int | str | bool | None
# entries of a list are named by the first of these that tells them apart: insertion does not
# rename what stands behind it, as a plain index would
_NAMES = ("id", "order", "frequency_hz", "name", "experiment")


def flatten(body: Mapping[str, Any]) -> dict[str, Leaf]:
    """Return every leaf of a JSON object under its path.

    Examples
    --------
    >>> flatten({"a": {"b": 1}, "c": [{"order": 2.0, "x": 3}]})
    {'a.b': 1, 'c[order=2.0].order': 2.0, 'c[order=2.0].x': 3}
    """
    leaves: dict[str, Leaf] = {}
    _walk("", body, leaves)
    return leaves


def _walk(path: str, value: Any, leaves: dict[str, Leaf]) -> None:
    if isinstance(value, Mapping):
        for key, item in value.items():
            _walk(f"{path}.{key}" if path else str(key), item, leaves)
    elif isinstance(value, list | tuple):
        for label, item in zip(_labels(value), value, strict=True):
            _walk(f"{path}[{label}]", item, leaves)
    else:
        leaves[path] = value


def _labels(items: Sequence[Any]) -> list[str]:
    if items and all(isinstance(item, Mapping) for item in items):
        for name in _NAMES:
            values = [item.get(name) for item in items]
            if all(map(_nominal, values)) and len(set(values)) == len(values):
                return [f"{name}={value}" for value in values]
    return [str(index) for index in range(len(items))]


def _nominal(value: Any) -> bool:
    """Return whether a value names its entry: text, or a number that was not measured."""
    if isinstance(value, int | float):
        # a measured number has all its digits; as a name it would change with every rounding
        return float(f"{value:g}") == value
    return isinstance(value, str)
