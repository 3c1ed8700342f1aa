"""The newest samples against the limits of the bench."""

from __future__ import annotations

import numpy as np

from hdbench.devices.hosted.settings import HostSettings
from hdbench.devices.ports import Block

__all__ = ["crossed_limit"]

# a converter's scale error; a limit is not crossed within it
_LIMIT_MARGIN = 1.001


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
