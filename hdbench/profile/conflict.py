"""Keys of a profile that do not go together."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Conflict"]


@dataclass(frozen=True, slots=True)
class Conflict:
    """Keys that do not go together.

    Parameters
    ----------
    key : tuple of str or int
        The key to look at.
    what : str
        What was found and what is needed, with unit.
    fix : str
        One next act.
    """

    key: tuple[str | int, ...]
    what: str
    fix: str
