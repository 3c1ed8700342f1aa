"""Orders for the guard."""

from __future__ import annotations

from hdbench.devices.guard.order import GuardOrder
from hdbench.devices.registry import driver_of
from hdbench.profile.acquiring import CompositeAcquisition
from hdbench.profile.schema import ProfileData
from hdbench.system.children import child_command

__all__ = ["order_of"]


def order_of(profile: ProfileData) -> GuardOrder:
    """Return what the guard of a bench is to do.

    Parameters
    ----------
    profile : ProfileData
        The bench, its addresses as they are in use.

    Returns
    -------
    GuardOrder
        The bytes themselves where the driver gives them; else a command that stops the bench
        through its driver, which takes as long as the libraries need to load.
    """
    table = profile.daq
    driving = table.outputs if isinstance(table, CompositeAcquisition) else table
    target = driver_of(driving.driver).stop_target(profile, driving)
    if target is None:
        command = child_command("hdbench.devices.guard.whole")
        return GuardOrder(command=command, stdin=profile.model_dump_json(exclude_none=True))
    return GuardOrder(targets=(target,))
