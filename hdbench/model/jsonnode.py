"""Checked access to the keys of a JSON object, with errors that name the place."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from hdbench.errors import DataError

__all__ = ["JsonNode"]


@dataclass(frozen=True, slots=True)
class JsonNode:
    """A JSON object with its place in the file; every read is checked.

    Parameters
    ----------
    value : dict
        The object.
    file : str
        Name of the file.
    key : str
        Dotted key of the object with a dot at its end; empty for the whole file.
    """

    value: dict[str, Any]
    file: str
    key: str

    def place(self, key: str) -> str:
        """Return file and dotted key, as errors name it."""
        return f"{self.file}: key {self.key}{key}"

    def get(self, key: str, kind: type | tuple[type, ...], needed: str) -> Any:
        """Return the value of `key` after checking its type."""
        found = self.value.get(key)
        if not isinstance(found, kind) or isinstance(found, bool):
            shown = repr(found)[:60] if key in self.value else "nothing"
            raise DataError(
                f"found {shown}; needed: {needed}",
                where=self.place(key),
                fix="correct the key, or write the model again with `hdbench diagnose`",
            )
        return found

    def node(self, key: str) -> JsonNode:
        """Return the object at `key`."""
        return JsonNode(self.get(key, dict, "an object"), self.file, f"{self.key}{key}.")

    def nodes(self, key: str) -> list[JsonNode]:
        """Return the objects of the list at `key`."""
        found = {str(i): item for i, item in enumerate(self.get(key, list, "a list of objects"))}
        parent = JsonNode(found, self.file, f"{self.key}{key}.")
        return [parent.node(index) for index in found]

    def number(self, key: str, low: float = -math.inf) -> float:
        """Return the finite number at `key`, at least `low`."""
        found = float(self.get(key, (int, float), "a number"))
        if not (low <= found < math.inf and found > -math.inf):
            raise DataError(
                f"found {found!r}; needed: a finite number, at least {low:g}",
                where=self.place(key),
                fix="correct the number",
            )
        return found
