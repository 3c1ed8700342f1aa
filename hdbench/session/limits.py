"""Limits and stuck channels, watched in every block of samples."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hdbench.devices.bench import Block, beyond, crossed_limit
from hdbench.errors import DeviceError
from hdbench.profile.schema import Limits
from hdbench.records import FloatArray
from hdbench.session.stop import Aborted


@dataclass(slots=True)
class LimitWatch:
    """Watches one acquisition."""

    limits: Limits
    start_rad: float = field(default=math.nan, init=False)

    def check(self, block: Block, rows: Mapping[str, FloatArray]) -> None:
        """Hold a block against every limit.

        Travel is the motor angle since the first sample of the acquisition.
        """
        limits = self.limits
        found = crossed_limit(block, rows, limits)
        if found is None and limits.travel_rad is not None and "motor_angle_rad" in rows:
            angle = rows["motor_angle_rad"][block.lost_before :]
            if math.isnan(self.start_rad) and len(block):
                self.start_rad = float(angle[0])
            travel = (limits.travel_rad, "rad")
            found = beyond("travel", angle - self.start_rad, travel, block.first_index)
        if found is not None:
            what, sample = found
            raise Aborted(
                what,
                where=f"sample {sample}",
                fix="find out why before raising the limit in the profile",
            )


# a channel that holds for 0.2 s holds through one of these windows, wherever they begin
_WINDOW_S = 0.1
_LEAST_SAMPLES = 10
# Speeds agree that differ by less than a quarter of the larger one, or by less than 1 % of what the
# tacho's channel can show: errors of scale and zero, and steps of a converter, stay below that.
_SHARE, _RANGE_SHARE = 0.25, 0.01
_HELD_S = 0.2
# order 2 of the ripple has been through a whole period then
_TURNED_RAD = math.pi


@dataclass(slots=True)
class SpeedWatch:
    """Watches one acquisition for a tacho or encoder that stands still while the motor turns."""

    sample_period_s: float
    range_rad_s: float
    _angles: list[FloatArray] = field(default_factory=list, init=False)
    _speeds: list[FloatArray] = field(default_factory=list, init=False)

    def check(self, block: Block, rows: Mapping[str, FloatArray]) -> None:
        """Hold tacho and encoder of a block against each other.

        A bench without an encoder or a tacho has nothing to compare; its limits are watched alone.
        """
        if "motor_angle_rad" not in rows or "motor_velocity_rad_s" not in rows:
            return
        if block.lost_before:
            # what happened meanwhile is not known
            self._angles, self._speeds = [], []
        self._angles.append(rows["motor_angle_rad"][block.lost_before :])
        self._speeds.append(rows["motor_velocity_rad_s"][block.lost_before :])
        least = max(_LEAST_SAMPLES, math.ceil(_WINDOW_S / self.sample_period_s))
        if sum(map(len, self._angles)) < least:
            return
        angles, speeds = np.concatenate(self._angles), np.concatenate(self._speeds)
        self._angles, self._speeds = [], []
        for first in range(0, len(angles) - least + 1, least):
            window = slice(first, first + least)
            self._compare(angles[window], speeds[window], block)

    def _compare(self, angles: FloatArray, speeds: FloatArray, block: Block) -> None:
        held = [name for name, values in (("tacho", speeds), ("encoder", angles))
                if float(np.ptp(values)) == 0.0]  # fmt: skip
        if not held:
            return
        lasting_s = (len(angles) - 1) * self.sample_period_s
        turned_rad_s = float(angles[-1] - angles[0]) / lasting_s
        tacho_rad_s = float(np.mean(speeds))
        larger_rad_s = max(abs(turned_rad_s), abs(tacho_rad_s))
        allowed = max(_RANGE_SHARE * self.range_rad_s, _SHARE * larger_rad_s)
        if abs(turned_rad_s - tacho_rad_s) <= allowed:
            return
        raise DeviceError(
            f"the {held[0]} did not change for {lasting_s:.3g} s: the tacho says "
            f"{tacho_rad_s:+.4g} rad/s, the encoder {turned_rad_s:+.4g} rad/s",
            where=f"channel {held[0]}, before sample {block.first_index + len(block)}",
            fix=f"the motor is stopped: check the {held[0]} and its cable, then run "
            "`hdbench monitor`",
        )


@dataclass(slots=True)
class HeldTorque:
    """Counts torque samples that did not change while the motor made half a turn or more.

    Half a turn is a whole period of the ripple of order 2, so a sensor that is connected has to
    move; a flat line shorter than 0.2 s is not counted.
    """

    sample_period_s: float
    _value: float = field(default=math.nan, init=False)
    _length: int = field(default=0, init=False)
    _start_rad: float = field(default=math.nan, init=False)
    _counted: bool = field(default=False, init=False)

    def count(self, torque: FloatArray, angle_rad: FloatArray) -> int:
        """Return how many samples are found to be held with these."""
        n = len(torque)
        if not n:
            return 0
        # NaN differs from everything, itself included
        changed = np.flatnonzero(torque != np.concatenate(([self._value], torque[:-1])))
        before = int(changed[0]) if len(changed) else n
        found = self._longer(before, float(angle_rad[before - 1])) if before else 0
        ends = np.append(changed[1:], n)
        for start in np.flatnonzero((ends - changed > 1) | (ends == n)) if len(changed) else ():
            first, end = int(changed[start]), int(ends[start])
            self._length, self._counted = 0, False
            self._start_rad = float(angle_rad[first])
            found += self._longer(end - first, float(angle_rad[end - 1]))
        self._value = float(torque[-1])
        return found

    def _longer(self, more: int, angle_rad: float) -> int:
        self._length += more
        if self._counted:
            return more
        # written so that NaN is no motion
        turned = abs(angle_rad - self._start_rad) >= _TURNED_RAD
        if not (turned and self._length * self.sample_period_s >= _HELD_S):
            return 0
        self._counted = True
        return self._length
