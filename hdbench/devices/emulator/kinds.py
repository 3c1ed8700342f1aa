"""The emulator of each driver."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

from hdbench.devices.emulator.instrument import SimulatedInstrument
from hdbench.devices.emulator.serve import EmulatorSettings
from hdbench.errors import UsageError
from hdbench.profile.acquiring import Acquisition
from hdbench.profile.schema import ProfileData

__all__ = ["Emulate", "EmulatedPart", "MakePart", "emulator_of", "part_of"]

_NODE = "hdbench.devices.emulator.serve:emulate_bench"
_INSTRUMENTS = "hdbench.devices.emulator.serving:emulate_instruments"
_EMULATORS = {
    "node": _NODE,
    "labjack-t": _INSTRUMENTS,
    "modbus": _INSTRUMENTS,
    "dataq": _INSTRUMENTS,
    "composite": _INSTRUMENTS,
}
_PARTS = {
    "labjack-t": "hdbench.devices.emulator.labjack.serve:labjack_part",
    "modbus": "hdbench.devices.emulator.modbus.serve:modbus_part",
    "dataq": "hdbench.devices.emulator.dataq.serve:dataq_part",
}


class EmulatedPart(Protocol):
    """One device at the terminals of a simulated bench that it may share with another one."""

    async def open(self, settings: EmulatorSettings) -> Mapping[str, object]:
        """Open its wire and return the keys of its table as it has them, ``address`` at least.

        Raises `OSError` if the wire cannot be used.
        """
        ...

    def close(self) -> None:
        """Close its wire."""
        ...


MakePart = Callable[[SimulatedInstrument, ProfileData, Acquisition, int], EmulatedPart]
"""Builds a device from its instrument, the bench's profile, its own table and the seed."""


class Emulate(Protocol):
    """Builds the simulated bench of a profile and serves it as one kind of device."""

    def __call__(
        self,
        profile: ProfileData,
        plant: str,
        seed: int,
        settings: EmulatorSettings,
        *,
        ready: Callable[[Mapping[str, object]], None],
        model_file: Path | None = None,
    ) -> None:
        """Serve until SIGTERM, Ctrl-C or the end of the lifeline.

        Calls `ready` once, with the keys of ``[daq]`` as the emulated device has them.
        """
        ...


def emulator_of(driver: str) -> Emulate:
    """Return the emulator of a driver.

    Parameters
    ----------
    driver : str
        Name of the driver.

    Returns
    -------
    callable

    Raises
    ------
    UsageError
        If it has none.
    """
    emulate: Emulate = _load(_EMULATORS, driver)
    return emulate


def part_of(driver: str) -> MakePart:
    """Return what builds a driver's emulated device around a given simulated bench.

    Parameters
    ----------
    driver : str
        Name of the driver.

    Returns
    -------
    callable

    Raises
    ------
    UsageError
        If it cannot be part of an emulated composite.
    """
    make: MakePart = _load(_PARTS, driver)
    return make


def _load(table: Mapping[str, str], driver: str) -> Any:
    module, _, function = table.get(driver, "").partition(":")
    try:
        return getattr(import_module(module), function)
    except (ImportError, ValueError, AttributeError) as error:
        raise UsageError(
            f"driver {driver!r} has no emulator for this",
            where="key daq.address",
            fix="name the address of a real device, or choose another driver",
        ) from error
