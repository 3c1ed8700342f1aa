"""Host settings: what a bench takes from the profile, and the limits that samples must keep."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.devices.bench import Block
from hdbench.devices.daq import Role
from hdbench.devices.feasibility import roles_of
from hdbench.profile.acquiring import CompositeAcquisition, OutputChannel
from hdbench.profile.schema import ProfileData

# of a device whose table has no [daq.output]
_UPDATE_S = 0.01
_SLEW_V_PER_S = 1000.0
# a converter's scale error; a limit is not crossed within it
_LIMIT_MARGIN = 1.001


@dataclass(frozen=True, slots=True)
class HostSettings:
    """How a bench is run from this computer.

    Parameters
    ----------
    roles : tuple of Role
        Channels to sample.
    watchdog_s : float
        Host silence after which the device makes its outputs safe, s.
    update_s : float
        Time between two values of a reference that the host writes, s.
    slew_v_per_s : float
        Fastest change of that reference, V/s.
    limit_v, velocity_rad_s, torque_nm, current_a : float
        Limits of reference, V, motor speed, rad/s, torque, N m, and motor current, A.
    tacho_rad_s_per_v, gain_nm_per_v : float
        Scales of tacho, rad/s/V, and torque, N m/V.
    counts_per_turn : int
        Encoder counts per motor turn.
    max_skew_s : float
        Largest doubt of the time of a reference that the host writes, on the clock of the samples,
        s; inf where it does not matter.
    """

    roles: tuple[Role, ...]
    watchdog_s: float
    update_s: float
    slew_v_per_s: float
    limit_v: float
    velocity_rad_s: float
    torque_nm: float
    current_a: float
    tacho_rad_s_per_v: float
    gain_nm_per_v: float
    counts_per_turn: int
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
    driving = table.outputs if isinstance(table, CompositeAcquisition) else table
    found = getattr(driving, "output", None)
    output = found if isinstance(found, OutputChannel) else None
    limits = profile.limits
    return HostSettings(
        roles=roles_of(table),
        watchdog_s=profile.daq.watchdog_s if watchdog_s is None else watchdog_s,
        update_s=output.update_s if output else _UPDATE_S,
        slew_v_per_s=output.slew_v_per_s if output else _SLEW_V_PER_S,
        limit_v=min(limits.reference_v, output.limit_v) if output else limits.reference_v,
        velocity_rad_s=limits.velocity_rad_s,
        torque_nm=limits.torque_nm,
        current_a=limits.current_a,
        tacho_rad_s_per_v=profile.tacho.gain_rad_s_per_v,
        gain_nm_per_v=profile.sensor.gain_nm_per_v,
        counts_per_turn=profile.encoder.counts_per_turn,
        max_skew_s=table.max_skew_s if isinstance(table, CompositeAcquisition) else math.inf,
    )


def crossed_limit(block: Block, limits: HostSettings) -> str:
    """Return which limit the samples of a block have crossed."""
    for name, values, limit, unit in (
        ("motor speed", block.tacho_v * limits.tacho_rad_s_per_v, limits.velocity_rad_s, "rad/s"),
        ("torque", block.torque_v * limits.gain_nm_per_v, limits.torque_nm, "N m"),
        ("motor current", block.motor_current_a, limits.current_a, "A"),
    ):
        if np.any(np.abs(values) > _LIMIT_MARGIN * limit):
            peak = float(np.nanmax(np.abs(values)))
            return (
                f"{name} {peak:.6g} {unit} crossed the limit {limit:g} {unit} after sample "
                f"{block.first_index}"
            )
    return ""
