"""Effects that a plant has beyond its model: torque in the channel, each by its own physics."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from hdbench.records.trace import FloatArray

# numbers of an effect with the domain in which a plant file may give them
AtLeastZero = Annotated[float, "at least 0"]
AboveZero = Annotated[float, "above 0"]
Whole = Annotated[float, "whole"]
BelowOne = Annotated[float, "at least 0, below 1"]


@dataclass(frozen=True, slots=True)
class PlantMotion:
    """True motion of the bench at the integration steps, each array of one shape."""

    time_s: FloatArray
    motor_angle_rad: FloatArray
    motor_velocity_rad_s: FloatArray
    output_angle_rad: FloatArray
    output_velocity_rad_s: FloatArray
    transmitted_nm: FloatArray


@dataclass(frozen=True, slots=True)
class Effect:
    """One effect; its numbers are those of its table in a plant file."""

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion; an effect on an angle has none."""
        return np.zeros_like(motion.time_s)


@dataclass(frozen=True, slots=True)
class AsymmetricFriction(Effect):
    """Friction that the output bearing has more of forward than backward.

    T = coulomb_difference v^2 / (v^2 + transition^2) + viscous_difference abs(v), v the output
    speed: both directions push the torque the same way.
    """

    coulomb_difference_nm: float
    viscous_difference_nm_s_per_rad: float
    transition_rad_s: AboveZero

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        speed = np.abs(motion.output_velocity_rad_s)
        square = speed * speed
        dry = square / (square + self.transition_rad_s**2)
        return self.coulomb_difference_nm * dry + self.viscous_difference_nm_s_per_rad * speed


@dataclass(frozen=True, slots=True)
class Cogging(Effect):
    """Torque between the magnets and the slots of the motor.

    With x = order theta_m + phase and r the decay, the sum over k of r^(k - 1) cos(k x) is
    (cos x - r) / (1 - 2 r cos x + r^2).
    """

    order: Whole
    amplitude_nm: AtLeastZero
    phase_rad: float
    decay: BelowOne

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        cosine = np.cos(self.order * motion.motor_angle_rad + self.phase_rad)
        shape = (cosine - self.decay) / (1.0 - 2.0 * self.decay * cosine + self.decay**2)
        return self.amplitude_nm * shape


@dataclass(frozen=True, slots=True)
class TransmissionError(Effect):
    """A recorded motor angle that wanders about the true one; no torque of its own."""

    order: AboveZero
    amplitude_rad: AtLeastZero
    phase_rad: float

    def angle_rad(self, output_angle_rad: FloatArray) -> FloatArray:
        """Return the error of the recorded motor angle, rad; 0 at the home mark."""
        at = np.cos(self.order * output_angle_rad + self.phase_rad) - np.cos(self.phase_rad)
        return np.asarray(self.amplitude_rad * at)


def encoder_error_rad(
    effects: Iterable[object], motor_angle_rad: FloatArray, gear_ratio: float
) -> FloatArray:
    """Return by how much the encoder is off."""
    total = np.zeros_like(motor_angle_rad)
    for effect in effects:
        if isinstance(effect, TransmissionError):
            total += effect.angle_rad(motor_angle_rad / gear_ratio)
    return total


@dataclass(frozen=True, slots=True)
class OutputFriction(Effect):
    """Friction of the output bearing, the only friction that the sensor carries.

    T = coulomb (2/pi) atan(v / transition) + viscous v, v the output speed.
    """

    coulomb_nm: AtLeastZero
    viscous_nm_s_per_rad: AtLeastZero
    transition_rad_s: AboveZero

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        speed = motion.output_velocity_rad_s
        rounded = np.arctan(speed / self.transition_rad_s) * (2.0 / math.pi)
        return self.coulomb_nm * rounded + self.viscous_nm_s_per_rad * speed


@dataclass(frozen=True, slots=True)
class MotorOrder(Effect):
    """A component that turns with the wave generator: amplitude cos(order theta_m + phase)."""

    order: AboveZero
    amplitude_nm: AtLeastZero
    phase_rad: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        return self.amplitude_nm * np.cos(self.order * motion.motor_angle_rad + self.phase_rad)


@dataclass(frozen=True, slots=True)
class OutputOrder(Effect):
    """A component that turns with the load: amplitude cos(order theta_o + phase)."""

    order: AboveZero
    amplitude_nm: AtLeastZero
    phase_rad: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        return self.amplitude_nm * np.cos(self.order * motion.output_angle_rad + self.phase_rad)


@dataclass(frozen=True, slots=True)
class Tone(Effect):
    """A component that follows the clock: amplitude cos(2 pi f t + phase)."""

    frequency_hz: AboveZero
    amplitude_nm: AtLeastZero
    phase_rad: float | None

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion; a phase of None counts as 0."""
        angle = 2.0 * math.pi * self.frequency_hz * motion.time_s
        return self.amplitude_nm * np.cos(angle + (self.phase_rad or 0.0))


@dataclass(frozen=True, slots=True)
class GainError(Effect):
    """A share of the transmitted torque that reads too much."""

    fraction: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        return self.fraction * motion.transmitted_nm


@dataclass(frozen=True, slots=True)
class ZeroStep(Effect):
    """A zero that jumps once in every acquisition."""

    at_s: AtLeastZero
    size_nm: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        return np.where(motion.time_s >= self.at_s, self.size_nm, 0.0)


@dataclass(frozen=True, slots=True)
class ZeroDrift(Effect):
    """A zero that runs away steadily, from 0 at the start of every acquisition."""

    rate_nm_per_s: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        return self.rate_nm_per_s * np.maximum(motion.time_s, 0.0)


@dataclass(frozen=True, slots=True)
class ToothBump(Effect):
    """A damaged tooth: a Gaussian bump at one place of every output turn."""

    center_rad: float
    width_rad: AboveZero
    height_nm: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        away = np.remainder(motion.output_angle_rad - self.center_rad + math.pi, 2.0 * math.pi)
        return self.height_nm * np.exp(-0.5 * ((away - math.pi) / self.width_rad) ** 2)


# what a plant file calls each of them
EFFECT_KINDS: dict[str, type[Effect]] = {
    "output-friction": OutputFriction,
    "motor-order": MotorOrder,
    "output-order": OutputOrder,
    "tone": Tone,
    "gain-error": GainError,
    "zero-step": ZeroStep,
    "zero-drift": ZeroDrift,
    "tooth-bump": ToothBump,
    "asymmetric-friction": AsymmetricFriction,
    "cogging": Cogging,
    "transmission-error": TransmissionError,
}


def effect_torque_nm(effects: tuple[Effect, ...], motion: PlantMotion) -> FloatArray:
    """Return the sum of `effects`."""
    total = np.zeros_like(motion.time_s)
    for effect in effects:
        total += effect.torque_nm(motion)
    return total


def start_effect(effect: Effect, rng: np.random.Generator) -> Effect:
    """Return `effect` as it is in a new acquisition."""
    if isinstance(effect, Tone) and effect.phase_rad is None:
        return replace(effect, phase_rad=float(rng.uniform(-math.pi, math.pi)))
    return effect
