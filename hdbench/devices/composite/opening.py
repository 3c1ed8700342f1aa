"""Open the two devices of a composite."""

from __future__ import annotations

from hdbench.devices.composite.driver import CompositeDaq
from hdbench.devices.driver import Driver
from hdbench.devices.registry import driver_of, open_daq
from hdbench.profile.acquiring import CompositeAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["DRIVER", "open_composite"]


def open_composite(profile: ProfileData, table: CompositeAcquisition) -> CompositeDaq:
    """Return the driver of both devices."""
    inputs = open_daq(profile, table.inputs)
    try:
        outputs = open_daq(profile, table.outputs)
    except BaseException:
        inputs.close()
        raise
    return CompositeDaq(inputs, outputs)


DRIVER = Driver(
    open=open_composite,
    rate_hz=lambda table: driver_of(table.inputs.driver).rate_hz(table.inputs),
    drives=lambda table: driver_of(table.outputs.driver).drives(table.outputs),
)
