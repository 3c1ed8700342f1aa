"""Devices: benches on the wire, their drivers, their guard and their emulators."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hdbench.devices.bench import AcquisitionSettings as AcquisitionSettings
    from hdbench.devices.opening import open_bench as open_bench
    from hdbench.devices.opening import stop_bench as stop_bench
    from hdbench.devices.operator import SimulatedOperator as SimulatedOperator

_PLACES = {
    "AcquisitionSettings": "bench",
    "SimulatedOperator": "operator",
    "open_bench": "opening",
    "stop_bench": "opening",
}


def __getattr__(name: str) -> Any:
    """Load what is asked for: the guard needs the wire below alone, and starts without the rest."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
