"""What is computed of a cause, beside its entry in the catalogue."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from hdbench.model.definition import always, unbounded
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["Computed"]

Shape = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Computed:
    """The functions of a cause, as `Cause` has them, and the bands of its first shape parameter."""

    columns: Callable[[Motion, Shape], FloatArray]
    applicable: Callable[[Motion], str | None] = always
    reach: Callable[[Motion], Mapping[str, tuple[float, float]]] = unbounded
    change_motion: Callable[[Motion, Shape], Motion] | None = None
    possible: Callable[[Motion, Shape], FloatArray] | None = None
    bands: tuple[tuple[float, float], ...] = ()
