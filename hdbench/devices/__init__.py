"""Devices: benches on the wire, their drivers, their guard and their emulators."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdbench import handed_out

if TYPE_CHECKING:
    from hdbench.devices.bench import AcquisitionSettings as AcquisitionSettings
    from hdbench.devices.opening import open_bench as open_bench
    from hdbench.devices.opening import stop_bench as stop_bench
    from hdbench.devices.operator import SimulatedOperator as SimulatedOperator

# the guard needs the wire below alone, and starts without the rest
__getattr__ = handed_out(
    __name__,
    {
        "AcquisitionSettings": "bench",
        "SimulatedOperator": "operator",
        "open_bench": "opening",
        "stop_bench": "opening",
    },
)
