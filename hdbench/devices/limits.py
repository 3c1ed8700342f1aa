"""Samples in their units, and the limits that they must keep."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from hdbench.devices.bench import Block
from hdbench.profile.schema import Limits, ProfileData
from hdbench.records.trace import FloatArray

# 0.1 % above a limit is within the converter's scale error, not a crossing
_MARGIN = 1.001
# columns that a bench without the channel does not have
_COLUMNS_OF = {
    "encoder": ("motor_angle_rad", "encoder_count"),
    "current": ("motor_current_a",),
    "reference": ("reference_v",),
}


def scaled(block: Block, profile: ProfileData, gain_nm_per_v: float) -> dict[str, FloatArray]:
    """Return the channels of a block in their units; a lost sample is NaN."""
    counts = block.encoder_count.astype(np.float64)
    present = {
        "motor_velocity_rad_s": block.tacho_v * profile.tacho.gain_rad_s_per_v,
        "motor_angle_rad": counts * (2.0 * math.pi / profile.encoder.counts_per_turn),
        "encoder_count": counts,
        "torque_nm": block.torque_v * gain_nm_per_v,
        "torque_v": block.torque_v,
        "tacho_v": block.tacho_v,
        "motor_current_a": block.motor_current_a,
        "reference_v": block.reference_v,
    }
    missing = {name for role in block.absent for name in _COLUMNS_OF.get(role, ())}
    lost = np.full(block.lost_before, math.nan)
    return {
        name: np.concatenate((lost, values))
        for name, values in present.items()
        if name not in missing
    }


def crossed_limit(
    block: Block, rows: Mapping[str, FloatArray], limits: Limits
) -> tuple[str, int] | None:
    """Return which limit of speed, torque or current the rows of a block cross, and the sample."""
    for name, role, column, limit, unit in (
        ("motor speed", "tacho", "motor_velocity_rad_s", limits.velocity_rad_s, "rad/s"),
        ("torque", "torque", "torque_nm", limits.torque_nm, "N m"),
        ("motor current", "current", "motor_current_a", limits.current_a, "A"),
    ):
        if role not in block.absent and column in rows:
            values = rows[column][block.lost_before :]
            found = beyond(name, values, (limit, unit), block.first_index)
            if found is not None:
                return found
    return None


def beyond(
    name: str, values: FloatArray, limit: tuple[float, str], first_index: int
) -> tuple[str, int] | None:
    """Return what is beyond a limit, and the index of that sample."""
    most, unit = limit
    # written so that NaN counts as a crossing
    at = np.flatnonzero(~(np.abs(values) <= _MARGIN * most))
    if not len(at):
        return None
    what = f"{name} {float(values[at[0]]):+.6g} {unit} crossed the limit {most:g} {unit}"
    return what, int(first_index + at[0])
