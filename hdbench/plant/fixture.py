"""Locked wave generator with arm and weights, and the sensor's gain by position and clamping."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hdbench.plant.plantfile import FixtureSpec
from hdbench.profile.calibrating import Arm
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray

# Time constant of a weight that nobody steadies, s: a steel weight of kilograms on a hanger of
# 0.3 m loses little to the air, so its swing outlasts any reading.
FREE_SWING_S = 60.0

# Every one of 2, 3, 4, 6, 8, 12 and 24 divides it: at so many equally spaced positions the sum of
# cos(h * spacing) over the harmonics 1..24 is zero, so the gains there are independent.
GAIN_HARMONICS = 24


@dataclass(frozen=True, slots=True)
class PositionGain:
    r"""Gain of the sensor by flexspline position: a random function without a single cause.

    :math:`G(\varphi) = G_0 [1 + c \, g(\varphi)]`,
    :math:`g = H^{-1/2} \sum_{h=1}^{H} a_h \cos h \varphi + b_h \sin h \varphi`, H = 24. There is no
    h = 0 term, so the average over the turn is :math:`G_0` for every seed; at any position g is
    standard normal over seeds.
    """

    mean_nm_per_v: float
    spread: float
    cosine: FloatArray
    sine: FloatArray

    @classmethod
    def draw(cls, mean_nm_per_v: float, spread: float, rng: np.random.Generator) -> PositionGain:
        """Return a gain function drawn from `rng`."""
        cosine, sine = rng.standard_normal((2, GAIN_HARMONICS))
        return cls(mean_nm_per_v, spread, cosine, sine)

    def at(self, position_rad: float) -> float:
        """Return the gain at `position_rad`, N m/V."""
        angle = np.arange(1, GAIN_HARMONICS + 1) * position_rad
        wave = float(self.cosine @ np.cos(angle) + self.sine @ np.sin(angle))
        return self.mean_nm_per_v * (1.0 + self.spread * wave / math.sqrt(GAIN_HARMONICS))


@dataclass(frozen=True, slots=True)
class ArmLoad:
    r"""Torque of arm and weight since the weight was last changed.

    The arm bounces as a second-order system with the damping ratio z,
    :math:`T = T_1 + (T_0 - T_1) e^{-z \omega t} (\cos \omega_d t + z / \sqrt{1 - z^2}
    \sin \omega_d t)`, and the weight swings as a pendulum: its vertical force goes as
    :math:`1 + \theta^2 \cos 2 \Omega t`, :math:`\Omega = \sqrt{g / l}`,
    :math:`\theta = \theta_0 e^{-t / \tau}`.
    """

    before_nm: float
    after_nm: float
    gravity_m_s2: float
    settling: FixtureSpec
    release_s: float = math.inf

    def torque_nm(self, age_s: FloatArray) -> FloatArray:
        """Return the torque at `age_s` after the change."""
        if math.isfinite(self.release_s):
            return self._released_nm(age_s)
        if self.before_nm == self.after_nm:
            return np.full_like(age_s, self.after_nm)
        s = self.settling
        age = np.maximum(age_s, 0.0)
        omega = 2.0 * math.pi * s.bounce_hz
        root = math.sqrt(1.0 - s.bounce_damping**2)
        turn = omega * root * age
        bounce = np.exp(-s.bounce_damping * omega * age) * (
            np.cos(turn) + s.bounce_damping / root * np.sin(turn)
        )
        swing = (s.swing_rad * np.exp(-age / s.swing_decay_s)) ** 2
        swing = swing * np.cos(2.0 * math.sqrt(self.gravity_m_s2 / s.pendulum_m) * age)
        moved = self.after_nm * (1.0 + swing) + (self.before_nm - self.after_nm) * bounce
        return np.where(age_s < 0.0, self.before_nm, moved)

    def _released_nm(self, age_s: FloatArray) -> FloatArray:
        """Return the torque of a weight that comes off again, N m."""
        hanging = replace(self, release_s=math.inf)
        still = self.settling.model_copy(update={"swing_rad": 0.0})
        at_nm = float(hanging.torque_nm(np.array([self.release_s]))[0])
        off = ArmLoad(at_nm, 0.0, self.gravity_m_s2, still)
        return np.where(
            age_s < self.release_s, hanging.torque_nm(age_s), off.torque_nm(age_s - self.release_s)
        )


@dataclass(frozen=True, slots=True)
class Mount:
    """State of lock, arm and weight."""

    locked: bool
    position_rad: float
    gain_nm_per_v: float
    load: ArmLoad
    since_s: float

    def torque_now_nm(self, now_s: float) -> float:
        """Return the arm's torque at acquisition time `now_s`, N m; 0 while not locked."""
        if not self.locked:
            return 0.0
        return float(self.load.torque_nm(np.array([now_s - self.since_s]))[0])


def shunt_volts(profile: ProfileData, shunt_ohm: float) -> float:
    r"""Return what a resistor across one arm of the bridge adds to the amplified reading."""
    if not shunt_ohm > 0.0:
        return 0.0
    declared = profile.calibration.shunt
    # 350 ohm is the usual bridge; a profile with a shunt says its own
    arm_ohm = 350.0 if declared is None else declared.bridge_ohm
    signal_v = profile.sensor.excitation_v * arm_ohm / (4.0 * shunt_ohm + 2.0 * arm_ohm)
    return signal_v * profile.sensor.amplifier_gain


@dataclass(eq=False)
class Fixture:
    """What is mounted now."""

    arm: Arm
    spec: FixtureSpec
    gain: PositionGain
    stream: Callable[[int], np.random.Generator]

    def __post_init__(self) -> None:
        self._clampings = 0
        self._direction = 1
        self._swing_rad, self._release_s = 0.0, 0.0
        still = ArmLoad(0.0, 0.0, self.arm.gravity_m_s2, self.spec)
        self.mount = Mount(False, 0.0, self.gain.mean_nm_per_v, still, 0.0)

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
        old = self.mount
        same_place = (old.locked, old.position_rad) == (locked, position_rad)
        gain = old.gain_nm_per_v
        if not (same_place and self._direction == direction):
            gain = self._clamp(locked, position_rad)
        self._direction = direction
        wanted = direction * mass_kg * self.arm.gravity_m_s2 * self.arm.length_m if locked else 0.0
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
        settling, release_s = self.spec, self._release_s or math.inf
        if self._swing_rad:
            free = {"swing_rad": self._swing_rad, "swing_decay_s": FREE_SWING_S}
            settling = settling.model_copy(update=free)
        return ArmLoad(before_nm, after_nm, self.arm.gravity_m_s2, settling, release_s)

    def _clamp(self, locked: bool, position_rad: float) -> float:
        """Return the gain of a new clamping, N m/V."""
        if not locked:
            return self.gain.mean_nm_per_v
        self._clampings += 1
        error = float(self.stream(self._clampings).standard_normal())
        return self.gain.at(position_rad) * (1.0 + self.spec.repeatability * error)
