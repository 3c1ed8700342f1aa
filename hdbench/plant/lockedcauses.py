"""What an extended model adds while the wave generator is locked and weights hang on the arm."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hdbench.plant.extended import ROOM_C
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

if TYPE_CHECKING:
    from hdbench.model import BenchModel
    from hdbench.plant.fixture import Mount

__all__ = ["LockedCauses"]

# a weight changes within this time, and samples are at least this far apart
_TICK_S = 1e-6


class LockedCauses:
    """Causes of an extended model under the weights that were hung since the lock was closed.

    Parameters
    ----------
    model : BenchModel
        An extended model.
    profile : ProfileData
        The bench.

    Notes
    -----
    Each weight counts with its torque at rest, from the time at which it was hung. A new position
    or direction is a new clamping, at which nothing that remembers is carried over.
    """

    def __init__(self, model: BenchModel, profile: ProfileData) -> None:
        self._model = model
        self._profile = profile
        self._held: list[Mount] = []

    def restart(self, elapsed_s: float) -> None:
        """Count time from a new acquisition, `elapsed_s` after the one before began."""
        self._held = [replace(mount, since_s=mount.since_s - elapsed_s) for mount in self._held]

    def change(self, mount: Mount) -> None:
        """Take note of what is mounted from now on."""
        if not mount.locked:
            self._held = []
            return
        if self._held and (mount.since_s <= self._held[-1].since_s or mount == self._held[-1]):
            self._held.pop()
        self._held.append(mount)

    def volts(self, time_s: FloatArray) -> FloatArray:
        """Return what the causes add to the torque channel."""
        if not self._held:
            return np.zeros(len(time_s))
        from hdbench.model import Motion

        steps = self._steps()
        now = self._held[-1]
        # samples that were taken before the last weight was hung see it already
        after = np.maximum(time_s, steps[-1][0] + _TICK_S * np.arange(1, len(time_s) + 1))
        time, load, position, starts = (np.array(column) for column in zip(*steps, strict=True))
        still = np.zeros(len(steps) + len(time_s))
        motion = Motion(
            time_s=np.concatenate((time, after)),
            velocity_rad_s=still,
            angle_rad=-_extended(position, now.position_rad, len(after)),
            acceleration_rad_s2=still,
            output_angle_rad=_extended(position, now.position_rad, len(after)),
            valid=np.ones(len(still), dtype=bool),
            angle_source="motor_angle_rad",
            gear_ratio=self._profile.drive.gear_ratio,
            load_torque_nm=_extended(load, now.load.after_nm, len(after)),
            motor_current_a=still,
            temperature_c=np.full(len(still), ROOM_C),
            inertia_nm_s2=self._model.inertia_nm_s2,
            starts=_extended(starts, 0.0, len(after)) > 0.0,
        )
        torque = self._model.cause_torque_nm(motion)[len(steps) :]
        return torque / self._profile.sensor.gain_nm_per_v

    def _steps(self) -> list[tuple[float, float, float, float]]:
        """Return time, torque, position and whether it begins anew, for every weight."""
        steps: list[tuple[float, float, float, float]] = []
        before: Mount | None = None
        for mount in self._held:
            anew = before is None or (before.position_rad, before.gain_nm_per_v) != (
                mount.position_rad,
                mount.gain_nm_per_v,
            )
            if before is not None and not anew and mount.since_s - _TICK_S > steps[-1][0]:
                last = before.load.after_nm
                steps.append((mount.since_s - _TICK_S, last, mount.position_rad, 0.0))
            steps.append((mount.since_s, mount.load.after_nm, mount.position_rad, float(anew)))
            before = mount
        return steps


def _extended(values: FloatArray, last: float, count: int) -> FloatArray:
    """Return `values` followed by `count` times `last`."""
    return np.concatenate((values, np.full(count, last)))
