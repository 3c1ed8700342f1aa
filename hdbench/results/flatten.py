"""A nested result as flat quantities, each under a path that a person can read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

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
