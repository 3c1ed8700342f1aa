"""Drivers: one record for every kind of device, and the registry of those that are installed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING, Any

from hdbench.devices.daq import Daq
from hdbench.errors import UsageError
from hdbench.profile import acquiring
from hdbench.profile.schema import ProfileData

if TYPE_CHECKING:
    from hdbench.devices.emulator.serving import EmulatedDevice, Emulation
    from hdbench.devices.guard.order import Target


@dataclass(frozen=True, kw_only=True)
class Driver:
    """One driver; only `open` is needed. ``table`` is its own table of the profile.

    Parameters
    ----------
    open : callable
        ``(profile, table) -> Daq``. Nothing is written yet. Raises `HdbenchError`, nothing else.
    verify : callable, optional
        ``(table) -> None``. Raises `ProfileError` where the table asks for what the device does not
        have; called before anything is opened.
    rate_hz : callable, optional
        ``(table) -> float``. Highest sustained scan rate of the table's channels, Hz, the wire
        included; inf where only the open device can tell.
    drives : callable, optional
        ``(table) -> bool``. Whether the device as described can put out the motor reference.
    stop_target : callable, optional
        ``(profile, table) -> Target or None``. Modbus requests by which the guard stops the motor;
        without them it stops the bench through the driver, which takes longer to start.
    emulate : callable, optional
        ``(emulation, table) -> EmulatedDevice``. A device of this kind around a simulated bench.
    emulated_speed : float, optional
        Device seconds per second that an emulation with a fast pace keeps.
    probe : callable, optional
        ``(port) -> str``. Asks who is on a serial port; empty where it is no such device.
    """

    open: Callable[[ProfileData, Any], Daq]
    verify: Callable[[Any], None] = lambda _: None
    rate_hz: Callable[[Any], float] = lambda _: math.inf
    drives: Callable[[Any], bool] = lambda _: True
    stop_target: Callable[[ProfileData, Any], Target | None] = lambda *_: None
    emulate: Callable[[Emulation, Any], EmulatedDevice] | None = None
    emulated_speed: float = 1.0
    probe: Callable[[str], str] | None = None


def later(place: str) -> Callable[..., Any]:
    """Return a function that is imported when it is first called."""

    def call(*given: Any) -> Any:
        module, _, name = place.partition(":")
        return getattr(import_module(module), name)(*given)

    return call


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
    """Return every driver that is installed; one that cannot be loaded is told, not fatal."""
    found: list[DriverInfo] = []
    for entry in acquiring.installed("hdbench.drivers"):
        taken = any(info.name == entry.name for info in found)
        problem = "its name is taken" if taken else _problem(entry)
        package = entry.dist
        origin = "hdbench" if package is None else f"{package.name} {package.version}"
        found.append(DriverInfo(entry.name, origin, problem))
    return tuple(found)


def driver_of(name: str) -> Driver:
    """Return the driver of a name."""
    entry = acquiring.find("hdbench.drivers", name)
    if entry is None:
        names, fix = acquiring.closest(name)
        raise UsageError(
            f"no driver {name!r} is installed; installed: {names}", where="key daq.driver", fix=fix
        )
    try:
        return _load(entry)
    except acquiring.BROKEN as error:
        raise UsageError(
            f"driver {name!r} cannot be loaded ({type(error).__name__}: {error})",
            where="key daq.driver",
            fix="install its package again, or choose another driver",
        ) from error


def probes() -> tuple[Callable[[str], str], ...]:
    """Return how the drivers ask who is on a serial port; those that cannot be loaded do not."""
    usable = (driver_of(info.name) for info in drivers() if not info.problem)
    return tuple(driver.probe for driver in usable if driver.probe is not None)


def open_daq(profile: ProfileData, table: acquiring.Acquisition) -> Daq:
    """Open the device that `table` names."""
    driver = driver_of(table.driver)
    if not isinstance(table, acquiring.table_of(table.driver)):
        raise UsageError(
            f"a {type(table).__name__} is no table of driver {table.driver!r}",
            where="key daq.driver",
            fix="load the profile again",
        )
    driver.verify(table)
    return driver.open(profile, table)


def _load(entry: EntryPoint) -> Driver:
    driver = entry.load()
    if not isinstance(driver, Driver):
        raise TypeError(f"{entry.value} is no Driver")
    return driver


def _problem(entry: EntryPoint) -> str:
    try:
        _load(entry)
        acquiring.load_table(entry.name)
    except acquiring.BROKEN as error:
        return f"{type(error).__name__}: {error}"
    return ""
