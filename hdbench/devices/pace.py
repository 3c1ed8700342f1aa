"""What the device of a profile can do, told from the profile alone."""

from __future__ import annotations

import math

from hdbench.devices.hosted.settings import roles_of
from hdbench.devices.registry import driver_of
from hdbench.errors import UsageError
from hdbench.profile.acquiring import Acquisition, CompositeAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["check_drives", "check_pace", "check_tables", "rate_limit_hz"]


def rate_limit_hz(table: Acquisition) -> float:
    """Return the highest sustained scan rate of a device and its wire with the table's channels."""
    return driver_of(table.driver).rate_hz(table)


def check_tables(profile: ProfileData) -> None:
    """Refuse a profile that asks its devices for what they do not have."""
    for table in _devices(profile.daq):
        driver_of(table.driver).verify(table)


def check_drives(profile: ProfileData, what: str) -> None:
    """Refuse a motion where no device of the profile can put out the motor's reference."""
    driving = _devices(profile.daq)[-1]
    if driver_of(driving.driver).drives(driving):
        return
    key = "daq" if driving is profile.daq else "daq.outputs"
    raise UsageError(
        f"{what} moves the motor; {driving.driver} at {driving.address} has no output in this "
        "profile",
        where=f"key {key}.output",
        fix='describe the output of the device, or add one that has: driver = "composite"',
    )


def check_pace(profile: ProfileData, sample_period_s: float, what: str) -> None:
    """Refuse a sampling period that the device of the profile cannot keep."""
    table = _devices(profile.daq)[0]
    rate_hz, limit_hz = 1.0 / sample_period_s, rate_limit_hz(table)
    # periods are decimal numbers: a rate equal to the limit differs by rounding
    if rate_hz <= limit_hz * (1.0 + 1e-9) or math.isnan(limit_hz):
        return
    raise UsageError(
        f"{what} asks for {rate_hz:.6g} samples/s; {len(roles_of(table))} channels of "
        f"{table.driver} at {table.address} sustain {limit_hz:.4g}",
        where="key daq.sample_period_s",
        fix=f"sample every {1.0 / limit_hz:.3g} s or more slowly, name fewer daq.channels, or "
        "use a faster line",
    )


def _devices(table: Acquisition) -> tuple[Acquisition, ...]:
    """Return the devices of a table: the one that samples first, the one that drives last."""
    if isinstance(table, CompositeAcquisition):
        return (table.inputs, table.outputs)
    return (table,)
