"""Open the two devices of a composite."""

from __future__ import annotations

from hdbench.devices.composite.driver import CompositeDaq
from hdbench.devices.registry import open_daq
from hdbench.errors import UsageError
from hdbench.profile.acquiring import Acquisition, CompositeAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["open_composite"]


def open_composite(profile: ProfileData, table: Acquisition) -> CompositeDaq:
    """Return the driver of both devices; an `hdbench.devices.registry.OpenDaq`.

    Parameters
    ----------
    profile : ProfileData
        The bench.
    table : CompositeAcquisition
        Both tables, each with its own address.

    Returns
    -------
    CompositeDaq

    Raises
    ------
    UsageError
        If a part cannot be opened as it is described.
    """
    if not isinstance(table, CompositeAcquisition):
        raise UsageError(
            f"driver {table.driver!r} is no composite",
            where="key daq.driver",
            fix='driver = "composite"',
        )
    inputs = open_daq(profile, table.inputs)
    try:
        outputs = open_daq(profile, table.outputs)
    except BaseException:
        inputs.close()
        raise
    return CompositeDaq(inputs, outputs)
