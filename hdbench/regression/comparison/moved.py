"""What the comparison of one kind of result hands out."""

from __future__ import annotations

from dataclasses import dataclass

from hdbench.regression.comparison.item import Compared
from hdbench.regression.comparison.orders import Pattern

__all__ = ["Moved"]


@dataclass(frozen=True, slots=True)
class Moved:
    """What two results of one kind say of each other.

    Parameters
    ----------
    quantities : tuple of Compared
        Numbers of both.
    pattern : Pattern or None
        Their orders as vectors.
    only_a, only_b : tuple of str
        Orders or causes that only one of them has and that would decide.
    """

    quantities: tuple[Compared, ...]
    pattern: Pattern | None = None
    only_a: tuple[str, ...] = ()
    only_b: tuple[str, ...] = ()
