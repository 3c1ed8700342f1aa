"""Whether the device of a profile is fast enough, told from the profile alone."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module

from hdbench.devices.hosted.settings import roles_of
from hdbench.errors import UsageError
from hdbench.profile.acquiring import Acquisition, CompositeAcquisition
from hdbench.profile.schema import ProfileData

__all__ = ["RateLimit", "check_drives", "check_pace", "rate_limit"]

# `rate_hz(table) -> float` of each driver: what its device and wire sustain, inf where embedded
_RATES = {
    "node": "hdbench.devices.node.opening:node_rate_hz",
    "labjack-t": "hdbench.devices.labjack.opening:labjack_rate_hz",
    "modbus": "hdbench.devices.modbus.opening:modbus_rate_hz",
    "dataq": "hdbench.devices.dataq.opening:dataq_rate_hz",
}
# drivers whose reference this computer writes to an output that the profile has to describe
_HOSTED = ("labjack-t", "modbus", "dataq")


@dataclass(frozen=True, slots=True)
class RateLimit:
    """How fast a device and its wire are.

    Parameters
    ----------
    rate_hz : float
        Highest sustained scan rate with the profile's channels, Hz; inf where nothing limits it.
    because : str
        Address and channels that it holds for.
    """

    rate_hz: float
    because: str


def rate_limit(table: Acquisition) -> RateLimit | None:
    """Return what the device of a table sustains; None where only the device itself can tell.

    Parameters
    ----------
    table : Acquisition
        ``[daq]``, or one part of a composite.

    Returns
    -------
    RateLimit or None
    """
    if isinstance(table, CompositeAcquisition):
        return rate_limit(table.inputs)
    module, _, function = _RATES.get(table.driver, "").partition(":")
    try:
        rate_hz = float(getattr(import_module(module), function)(table))
    except (ImportError, ValueError, AttributeError):
        return None
    n_channels = len(roles_of(table))
    return RateLimit(rate_hz, f"{n_channels} channels of {table.driver} at {table.address}")


def check_drives(profile: ProfileData, what: str) -> None:
    """Refuse a motion where no device of the profile can put out the motor's reference.

    Parameters
    ----------
    profile : ProfileData
        The bench.
    what : str
        What asks for the motion.

    Raises
    ------
    UsageError
        If nothing in ``[daq]`` drives. Of a driver of another package only the device can tell.
    """
    table = profile.daq
    driving = table.outputs if isinstance(table, CompositeAcquisition) else table
    key = "daq.outputs" if isinstance(table, CompositeAcquisition) else "daq"
    # a node makes its reference itself
    if driving.driver not in _HOSTED or getattr(driving, "output", None) is not None:
        return
    raise UsageError(
        f"{what} moves the motor; {driving.driver} at {driving.address} has no output in this "
        "profile",
        where=f"key {key}.output",
        fix='describe the output of the device, or add one that has: driver = "composite"',
    )


def check_pace(profile: ProfileData, sample_period_s: float, what: str) -> None:
    """Refuse a sampling period that the device of the profile cannot keep.

    Parameters
    ----------
    profile : ProfileData
        The bench.
    sample_period_s : float
        What is asked for, s.
    what : str
        What asks for it.

    Raises
    ------
    UsageError
        If the device or its wire is too slow.
    """
    limit = rate_limit(profile.daq)
    rate_hz = 1.0 / sample_period_s
    # periods are decimal numbers: a rate equal to the limit differs by rounding
    if limit is None or rate_hz <= limit.rate_hz * (1.0 + 1e-9):
        return
    raise UsageError(
        f"{what} asks for {rate_hz:.6g} samples/s; {limit.because} sustain {limit.rate_hz:.4g}",
        where="key daq.sample_period_s",
        fix=f"sample every {1.0 / limit.rate_hz:.3g} s or more slowly, name fewer daq.channels, or "
        "use a faster line",
    )
