"""Limits, held against every block of samples."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hdbench.devices.bench import Block
from hdbench.profile.schema import Limits
from hdbench.records import FloatArray
from hdbench.session.stop import Aborted

__all__ = ["LimitWatch"]

# 0.1 % above a limit is within the converter's scale error, not a crossing
_MARGIN = 1.001


@dataclass(slots=True)
class LimitWatch:
    """Watches one acquisition.

    Parameters
    ----------
    limits : Limits
        Of the profile.
    """

    limits: Limits
    start_rad: float = field(default=math.nan, init=False)

    def check(self, block: Block, rows: Mapping[str, FloatArray]) -> None:
        """Hold a block against every limit.

        Notes
        -----
        Travel is the motor angle since the first sample of the acquisition.
        """
        limits, lost = self.limits, block.lost_before
        watched = [
            ("motor speed", "tacho", "motor_velocity_rad_s", limits.velocity_rad_s, "rad/s"),
            ("torque", "torque", "torque_nm", limits.torque_nm, "N m"),
            ("motor current", "current", "motor_current_a", limits.current_a, "A"),
        ]
        for name, role, column, limit, unit in watched:
            if role not in block.absent and column in rows:
                _hold(name, rows[column][lost:], (limit, unit), block.first_index)
        if limits.travel_rad is not None and "motor_angle_rad" in rows and len(block):
            angle = rows["motor_angle_rad"][lost:]
            if math.isnan(self.start_rad):
                self.start_rad = float(angle[0])
            _hold("travel", angle - self.start_rad, (limits.travel_rad, "rad"), block.first_index)


def _hold(name: str, values: FloatArray, limit: tuple[float, str], first_index: int) -> None:
    most, unit = limit
    # written so that NaN counts as a crossing
    beyond = np.flatnonzero(~(np.abs(values) <= _MARGIN * most))
    if len(beyond):
        raise Aborted(
            f"{name} {float(values[beyond[0]]):+.6g} {unit} crossed the limit {most:g} {unit}",
            where=f"sample {int(first_index + beyond[0])}",
            fix="find out why before raising the limit in the profile",
        )
