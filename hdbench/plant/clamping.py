"""Lock, flexspline position and weights as a person changes them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hdbench.errors import UsageError
from hdbench.plant.fixture import (
    FREE_SWING_S,
    ArmLoad,
    Mount,
    PositionGain,
    Settling,
)
from hdbench.plant.plantschema import FixtureSpec
from hdbench.profile.schema import Arm

__all__ = ["Fixture"]


class Fixture:
    """What is mounted now.

    Parameters
    ----------
    arm : Arm
        The profile's table.
    spec : FixtureSpec
        The plant's table.
    gain : PositionGain
        Gain of the sensor by position.
    stream : callable
        ``stream(number)`` gives the random generator of that clamping.
    """

    def __init__(
        self,
        arm: Arm,
        spec: FixtureSpec,
        gain: PositionGain,
        stream: Callable[[int], np.random.Generator],
    ) -> None:
        self._arm = arm
        self._repeatability = spec.repeatability
        self._settling = Settling(
            spec.bounce_hz, spec.bounce_damping, spec.swing_rad, spec.pendulum_m, spec.swing_decay_s
        )
        self._gain = gain
        self._stream = stream
        self._clampings = 0
        self._direction = 1
        self._swing_rad, self._release_s = 0.0, 0.0
        still = ArmLoad(0.0, 0.0, arm.gravity_m_s2, self._settling)
        self.mount = Mount(False, 0.0, gain.mean_nm_per_v, still, 0.0)

    def restart(self, elapsed_s: float) -> None:
        """Count time from a new acquisition."""
        self.mount = replace(self.mount, since_s=self.mount.since_s - elapsed_s)

    def handle(self, *, swing_rad: float, release_s: float) -> None:
        """Set how the next weight is handled."""
        self._swing_rad, self._release_s = swing_rad, release_s

    def change(
        self, now_s: float, *, locked: bool, position_rad: float, mass_kg: float, direction: int
    ) -> Mount:
        """Lock or release, turn the flexspline, hang a weight."""
        if not (math.isfinite(position_rad) and 0.0 <= mass_kg < math.inf and direction in (1, -1)):
            raise UsageError(
                f"position {position_rad!r} rad, mass {mass_kg!r} kg, direction {direction!r}; "
                "needed: finite, at least 0, and +1 or -1",
                where="simulated fixture",
                fix="give values in their domain",
            )
        old = self.mount
        same_place = (old.locked, old.position_rad) == (locked, position_rad)
        gain = old.gain_nm_per_v
        if not (same_place and self._direction == direction):
            gain = self._clamp(locked, position_rad)
        self._direction = direction
        wanted = (
            direction * mass_kg * self._arm.gravity_m_s2 * self._arm.length_m if locked else 0.0
        )
        load, since_s = old.load, old.since_s
        if not (same_place and wanted == load.after_nm and math.isinf(load.release_s)):
            before = old.torque_now_nm(now_s) if locked else 0.0
            load = self._handled(before, wanted)
            since_s = now_s
        self._swing_rad, self._release_s = 0.0, 0.0
        self.mount = Mount(locked, position_rad, gain, load, since_s)
        return self.mount

    def _handled(self, before_nm: float, after_nm: float) -> ArmLoad:
        """Return a new load, handled as was asked."""
        settling, release_s = self._settling, self._release_s or math.inf
        if self._swing_rad:
            settling = replace(settling, swing_rad=self._swing_rad, swing_decay_s=FREE_SWING_S)
        return ArmLoad(before_nm, after_nm, self._arm.gravity_m_s2, settling, release_s)

    def _clamp(self, locked: bool, position_rad: float) -> float:
        """Return the gain of a new clamping, N m/V."""
        if not locked:
            return self._gain.mean_nm_per_v
        self._clampings += 1
        error = float(self._stream(self._clampings).standard_normal())
        return self._gain.at(position_rad) * (1.0 + self._repeatability * error)
