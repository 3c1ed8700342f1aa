"""Installed drivers by name: those of hdbench, and those of other packages by entry point."""

from __future__ import annotations

import difflib
from importlib.metadata import EntryPoint, entry_points
from typing import Literal

Group = Literal["hdbench.drivers", "hdbench.tables"]
"""Entry points of drivers, and of the tables that describe their devices in a profile."""

BROKEN = (ImportError, AttributeError, TypeError, ValueError, SyntaxError)
"""What loading a package that does not fit may raise."""

# where the driver of a name is, and its table
_OWN = {
    "node": ("hdbench.devices.node.opening", "hdbench.profile.acquiring_table:NodeAcquisition"),
    "modbus": (
        "hdbench.devices.modbus.opening",
        "hdbench.profile.acquiring_modbus:ModbusAcquisition",
    ),
    "labjack-t": (
        "hdbench.drivers.labjack.record",
        "hdbench.drivers.labjack.table:LabJackAcquisition",
    ),
    "dataq": ("hdbench.drivers.dataq.record", "hdbench.drivers.dataq.table:DataqAcquisition"),
    "composite": (
        "hdbench.devices.composite",
        "hdbench.profile.acquiring:CompositeAcquisition",
    ),
}


def installed(group: Group) -> tuple[EntryPoint, ...]:
    """Return what is installed; hdbench's own first, so that nobody takes the name of one."""
    own = (_own(group, name) for name in _OWN)
    return (*own, *sorted(entry_points(group=group), key=lambda entry: entry.name))


def find(group: Group, name: str) -> EntryPoint | None:
    """Return what is installed under a name, None where there is nothing."""
    if name in _OWN:
        return _own(group, name)
    return next(iter(entry_points(group=group, name=name)), None)


def closest(name: str) -> tuple[str, str]:
    """Return which drivers are installed, and what to do where `name` is none of them."""
    names = list(dict.fromkeys(entry.name for entry in installed("hdbench.drivers")))
    near = difflib.get_close_matches(name, names, n=1)
    fix = f"did you mean {near[0]!r}?" if near else "install the package that brings this driver"
    return ", ".join(names), fix


def _own(group: Group, name: str) -> EntryPoint:
    module, table = _OWN[name]
    return EntryPoint(name, table if group == "hdbench.tables" else f"{module}:DRIVER", group)
