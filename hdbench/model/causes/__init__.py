"""Catalogue of causes: texts and parameters as data, and the modules that compute them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from hdbench.model.causes import (
    acquisition,
    dynamics,
    kinematic,
    periodic,
    sensor,
)
from hdbench.model.definition import Cause, Parameter, is_harmonic
from hdbench.system.files import packaged_toml

__all__ = ["ALL_CAUSES", "CAUSE_GROUPS"]

_COMPUTED = {
    name: computed
    for module in (periodic, kinematic, sensor, dynamics, acquisition)
    for name, computed in module.COMPUTED.items()
}


_TEXTS = ("equation", "locked_to", "parity", "channel", "experiment", "source")
_FUNCTIONS = ("columns", "applicable", "reach", "change_motion", "possible")


def _parameters(entry: Mapping[str, Any], kind: str) -> tuple[Parameter, ...]:
    defaults = entry.get("defaults", {})
    return tuple(
        Parameter(name, unit, lower, upper, what, default=defaults.get(name))
        for name, unit, lower, upper, what in entry.get(kind, ())
    )


def _cause(name: str, entry: Mapping[str, Any]) -> Cause:
    computed = _COMPUTED[name]
    shape, linear = _parameters(entry, "shape"), _parameters(entry, "linear")
    if computed.bands:
        shape = (replace(shape[0], bands=computed.bands), *shape[1:])
    return Cause(
        name=name,
        **{text: entry[text] for text in _TEXTS},
        shape=shape,
        linear=linear,
        look_alikes=tuple(entry["look_alikes"]),
        harmonic=is_harmonic(linear),
        channels=tuple(entry.get("channels", ())),
        additive=bool(linear),
        whole_signal=entry.get("whole_signal", False),
        common=entry.get("common", False),
        form_of=entry.get("form_of", ""),
        **{part: getattr(computed, part) for part in _FUNCTIONS},
    )


def _groups() -> Mapping[str, tuple[Cause, ...]]:
    groups: dict[str, tuple[Cause, ...]] = {}
    for name, entry in packaged_toml(__package__, "catalogue.toml").items():
        group = entry["group"]
        groups[group] = (*groups.get(group, ()), _cause(name, entry))
    return MappingProxyType(groups)


CAUSE_GROUPS: Mapping[str, tuple[Cause, ...]] = _groups()
ALL_CAUSES: tuple[Cause, ...] = tuple(c for group in CAUSE_GROUPS.values() for c in group)
