"""Drivers by name: those that come with hdbench, and those of other packages."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points

from hdbench.devices.daq import Daq
from hdbench.errors import UsageError
from hdbench.profile.acquiring import Acquisition
from hdbench.profile.schema import ProfileData

__all__ = ["GROUP", "DriverInfo", "OpenDaq", "drivers", "open_daq"]

GROUP = "hdbench.drivers"

OpenDaq = Callable[[ProfileData, Acquisition], Daq]
"""Opens the device that a table names: of the table in hand, scales and limits of the profile.

The address is that of the table; nothing is written yet. Raises `HdbenchError`, nothing else.
"""

# the function of each driver that comes with hdbench
_BUILT_IN = {
    "node": "hdbench.devices.node.opening:open_node",
    "modbus": "hdbench.devices.modbus.opening:open_modbus",
    "labjack-t": "hdbench.devices.labjack.opening:open_labjack",
    "dataq": "hdbench.devices.dataq.opening:open_dataq",
    "composite": "hdbench.devices.composite.opening:open_composite",
}


@dataclass(frozen=True, slots=True)
class DriverInfo:
    """One driver as ``hdbench doctor`` and run.json list it.

    Parameters
    ----------
    name : str
        The value of ``driver`` in the profile.
    origin : str
        ``hdbench``, or the other package and its version.
    problem : str
        Why it cannot be used; empty where it can.
    """

    name: str
    origin: str
    problem: str = ""


def drivers() -> tuple[DriverInfo, ...]:
    """Return every driver that is installed; one that cannot be loaded is told, not fatal.

    Returns
    -------
    tuple of DriverInfo
        Those of hdbench first; a plugin never takes the name of one of them.
    """
    found = [DriverInfo(name, "hdbench", _problem(partial(_built_in, name))) for name in _BUILT_IN]
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        taken = any(info.name == entry.name for info in found)
        problem = "its name is taken" if taken else _problem(partial(_plugin, entry))
        found.append(DriverInfo(entry.name, _origin(entry), problem))
    return tuple(found)


def open_daq(profile: ProfileData, table: Acquisition) -> Daq:
    """Open the device that `table` names.

    Parameters
    ----------
    profile : ProfileData
        Scales and limits of the bench.
    table : Acquisition
        ``[daq]`` of the profile, or one part of a composite.

    Returns
    -------
    Daq

    Raises
    ------
    UsageError
        If no such driver is installed, or it cannot be loaded.
    DeviceError, BusyError
        If the device cannot be opened.
    """
    name = table.driver
    if name in _BUILT_IN:
        return _loaded(name, partial(_built_in, name))(profile, table)
    entry = next(iter(entry_points(group=GROUP, name=name)), None)
    if entry is None:
        installed = [*_BUILT_IN, *entry_points(group=GROUP).names]
        near = difflib.get_close_matches(name, installed, n=1)
        raise UsageError(
            f"no driver {name!r} is installed; installed: {', '.join(installed)}",
            where="key daq.driver",
            fix=f"did you mean {near[0]!r}?" if near else "install the package that brings it",
        )
    return _loaded(name, partial(_plugin, entry))(profile, table)


def _loaded(name: str, load: Callable[[], OpenDaq]) -> OpenDaq:
    try:
        return load()
    except (ImportError, AttributeError, TypeError, ValueError, SyntaxError) as error:
        raise UsageError(
            f"driver {name!r} cannot be loaded ({type(error).__name__}: {error})",
            where="key daq.driver",
            fix="install its package again, or choose another driver",
        ) from error


def _problem(load: Callable[[], OpenDaq]) -> str:
    try:
        load()
    except (ImportError, AttributeError, TypeError, ValueError, SyntaxError) as error:
        return f"{type(error).__name__}: {error}"
    return ""


def _built_in(name: str) -> OpenDaq:
    module, _, function = _BUILT_IN[name].partition(":")
    opener: OpenDaq = getattr(import_module(module), function)
    return opener


def _plugin(entry: EntryPoint) -> OpenDaq:
    opener = entry.load()
    if not callable(opener):
        raise TypeError(f"{entry.value} is no function")
    plugin: OpenDaq = opener
    return plugin


def _origin(entry: EntryPoint) -> str:
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist is not None else "unknown"
