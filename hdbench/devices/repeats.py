"""How often a driver had to ask again."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

__all__ = ["Repeating", "repeats_of"]


@runtime_checkable
class Repeating(Protocol):
    """A driver that counts what it sends again."""

    @property
    def repeats(self) -> int:
        """Requests that were sent again so far."""
        ...


def repeats_of(daq: object) -> int:
    """Return how many requests a driver has sent again so far; 0 where it does not count."""
    return daq.repeats if isinstance(daq, Repeating) else 0
