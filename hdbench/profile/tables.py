"""Common parts of the tables of a profile, and how keys that do not go together are refused."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

CONFLICT = "conflict"
NonNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]


def item(meaning: str, default: Any = ..., **limits: Any) -> Any:
    """Return the field of a key: what it means, what stands for it, and its limits."""
    return Field(default, description=meaning, **limits)


@dataclass(frozen=True, slots=True)
class Conflict:
    """Keys that do not go together."""

    key: tuple[str | int, ...]  # the key to look at, from the table or value that is checked
    what: str  # what was found and what is needed, with unit
    fix: str  # one next act


class Table(BaseModel):
    """A profile table: unknown keys, NaN and infinities are errors; values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        refuse(self.conflicts())
        return self

    def conflicts(self) -> Iterable[Conflict]:
        """Return the keys of this table that do not go together."""
        return ()


def refuse(conflicts: Iterable[Conflict]) -> None:
    """Refuse a value where its keys do not go together; nothing without conflicts."""
    found = list(conflicts)
    if found:
        told = "; ".join(f"{'.'.join(map(str, c.key))} {c.what}".strip() for c in found)
        raise PydanticCustomError(CONFLICT, "{told}", {"told": told, "conflicts": found})
