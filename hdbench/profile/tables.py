"""What every table of a profile has in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from hdbench.profile.conflict import Conflict

__all__ = ["NonNegative", "Positive", "Table", "refuse"]

_T = TypeVar("_T", bound=BaseModel)
NonNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]


class Table(BaseModel):
    """A profile table: unknown keys, NaN and infinities are errors; values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


def refuse(table: _T, conflicts: Sequence[Conflict]) -> _T:
    """Return the table, or refuse it where its keys do not go together."""
    if conflicts:
        raise ValueError("; ".join(f"{conflict.key[-1]} {conflict.what}" for conflict in conflicts))
    return table
