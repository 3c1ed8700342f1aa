"""Blocks and numbers of a filter model between JSON and dataclasses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from hdbench.errors import DataError
from hdbench.filter.blocks import OscillatorBlock, SlowBlock

__all__ = ["bad_file", "block_dict", "number", "read_block", "read_slow", "slow_dict", "typed"]

_BLOCK_KEYS = ("order", "role", "process_noise")
_BLOCK_MORE = {"noise_per": "sample", "frequency_hz": 0.0}


def bad_file(what: str, where: str) -> DataError:
    """Return the error of a filter-model file."""
    return DataError(what, where=where, fix="correct the filter-model file or write it again")


def typed(body: Mapping[str, Any], key: str, kind: type, where: str) -> Any:
    """Return the value of a key if it is of the kind needed."""
    value = body.get(key)
    if not isinstance(value, kind):
        raise bad_file(f"{key} is {value!r}; needed: {kind.__name__}", f"{where}:{key}")
    return value


def number(body: Mapping[str, Any], key: str, where: str) -> float:
    """Return the finite number of a key."""
    value = body.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise bad_file(f"{key} is {value!r}; needed: a finite number", f"{where}:{key}")
    return float(value)


def block_dict(block: OscillatorBlock) -> dict[str, object]:
    """Return an oscillator block as its JSON object; defaults of the report are left out."""
    names = [*_BLOCK_KEYS, *(n for n, plain in _BLOCK_MORE.items() if getattr(block, n) != plain)]
    return {name: getattr(block, name) for name in names}


def read_block(item: object, where: str) -> OscillatorBlock:
    """Read an oscillator block."""
    needed = set(_BLOCK_KEYS)
    if not isinstance(item, Mapping) or not needed <= set(item) <= needed | set(_BLOCK_MORE):
        raise bad_file(f"found {item!r}; needed: an object with {', '.join(sorted(needed))}", where)
    try:
        return OscillatorBlock(
            number(item, "order", where),
            item["role"],
            number(item, "process_noise", where),
            item.get("noise_per", "sample"),
            number(item, "frequency_hz", where) if "frequency_hz" in item else 0.0,
        )
    except ValueError as error:
        raise bad_file(str(error), where) from error


def slow_dict(block: SlowBlock) -> dict[str, object]:
    """Return a slow-torque block as its JSON object."""
    return {"kind": block.kind, **{name: getattr(block, name) for name in block.parameters}}


def read_slow(item: object, where: str) -> SlowBlock:
    """Read a slow-torque block."""
    names = {"noise_per_s", "variance", "time_constant_s", "frequency_hz"}
    if not isinstance(item, Mapping) or "kind" not in item or not set(item) <= names | {"kind"}:
        raise bad_file(f"found {item!r}; needed: an object with kind and its numbers", where)
    try:
        numbers = {name: number(item, name, where) for name in names & set(item)}
        return SlowBlock(typed(item, "kind", str, where), **numbers)
    except ValueError as error:
        raise bad_file(str(error), where) from error
