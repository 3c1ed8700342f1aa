"""Host settings: what a bench takes from the profile, and the limits that samples must keep."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.devices.bench import Block
from hdbench.devices.daq import Role
from hdbench.devices.feasibility import roles_of
from hdbench.profile.acquiring import OutputChannel
from hdbench.profile.schema import ProfileData

# a converter's scale error; a limit is not crossed within it
_LIMIT_MARGIN = 1.001


@dataclass(frozen=True, slots=True)
class HostSettings:
    """How a bench is run from this computer.

    Parameters
    ----------
    profile : ProfileData
        The bench, for its limits and scales.
    roles : tuple of Role
        Channels to sample.
    watchdog_s : float
        Host silence after which the device makes its outputs safe, s.
    output : OutputChannel
        Limit, pace and slew of a reference that the host writes.
    max_skew_s : float
        Largest doubt of the time of a reference that the host writes, on the clock of the samples,
        s; inf where it does not matter.
    """

    profile: ProfileData
    roles: tuple[Role, ...]
    watchdog_s: float
    output: OutputChannel
    max_skew_s: float = math.inf


def host_settings(profile: ProfileData, *, watchdog_s: float | None = None) -> HostSettings:
    """Return the adapter's settings of a profile.

    Parameters
    ----------
    profile : ProfileData
        The bench.
    watchdog_s : float, optional
        Watchdog time in place of the profile's, s.

    Returns
    -------
    HostSettings
    """
    table = profile.daq
    *_, driving = table.part_tables().values()
    found = getattr(driving, "output", None)
    limit_v = profile.limits.reference_v
    return HostSettings(
        profile,
        roles_of(table),
        table.watchdog_s if watchdog_s is None else watchdog_s,
        found if isinstance(found, OutputChannel) else OutputChannel(limit_v=limit_v),
        getattr(table, "max_skew_s", math.inf),
    )


def crossed_limit(block: Block, profile: ProfileData) -> str:
    """Return which limit the samples of a block have crossed."""
    limits = profile.limits
    speed = block.tacho_v * profile.tacho.gain_rad_s_per_v
    for name, values, limit, unit in (
        ("motor speed", speed, limits.velocity_rad_s, "rad/s"),
        ("torque", block.torque_v * profile.sensor.gain_nm_per_v, limits.torque_nm, "N m"),
        ("motor current", block.motor_current_a, limits.current_a, "A"),
    ):
        if np.any(np.abs(values) > _LIMIT_MARGIN * limit):
            peak = float(np.nanmax(np.abs(values)))
            return (
                f"{name} {peak:.6g} {unit} crossed the limit {limit:g} {unit} after sample "
                f"{block.first_index}"
            )
    return ""
