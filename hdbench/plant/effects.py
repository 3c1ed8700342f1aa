"""Effects that a plant has beyond its model: torque in the channel, each by its own physics."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hdbench.plant.drivetrain import AsymmetricFriction, Cogging, TransmissionError
from hdbench.plant.truemotion import PlantMotion
from hdbench.records.trace import FloatArray

__all__ = [
    "EFFECT_KINDS",
    "Effect",
    "GainError",
    "MotorOrder",
    "OutputFriction",
    "OutputOrder",
    "Tone",
    "ToothBump",
    "ZeroDrift",
    "ZeroStep",
    "effect_torque_nm",
    "start_effect",
]


@dataclass(frozen=True, slots=True)
class OutputFriction:
    """Friction of the output bearing, the only friction that the sensor carries.

    Parameters
    ----------
    coulomb_nm : float
        Level far above the transition, N m, at least 0.
    viscous_nm_s_per_rad : float
        Slope over the output speed, N m s/rad, at least 0.
    transition_rad_s : float
        Output speed at which the Coulomb part has half its level, rad/s, above 0.

    Notes
    -----
    T = coulomb (2/pi) atan(v / transition) + viscous v, v the output speed.
    """

    coulomb_nm: float
    viscous_nm_s_per_rad: float
    transition_rad_s: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        speed = motion.output_velocity_rad_s
        rounded = np.arctan(speed / self.transition_rad_s) * (2.0 / math.pi)
        return self.coulomb_nm * rounded + self.viscous_nm_s_per_rad * speed


@dataclass(frozen=True, slots=True)
class MotorOrder:
    """A component that turns with the wave generator: amplitude cos(order theta_m + phase).

    Parameters
    ----------
    order : float
        Cycles per motor turn, above 0; need not be whole.
    amplitude_nm : float
        Amplitude, N m.
    phase_rad : float
        Phase at motor angle 0, rad.
    """

    order: float
    amplitude_nm: float
    phase_rad: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        return self.amplitude_nm * np.cos(self.order * motion.motor_angle_rad + self.phase_rad)


@dataclass(frozen=True, slots=True)
class OutputOrder:
    """A component that turns with the load: amplitude cos(order theta_o + phase).

    Parameters
    ----------
    order : float
        Cycles per output turn, above 0. Order 2 is angular misalignment.
    amplitude_nm : float
        Amplitude, N m.
    phase_rad : float
        Phase at output angle 0, rad.
    """

    order: float
    amplitude_nm: float
    phase_rad: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        return self.amplitude_nm * np.cos(self.order * motion.output_angle_rad + self.phase_rad)


@dataclass(frozen=True, slots=True)
class Tone:
    """A component that follows the clock: amplitude cos(2 pi f t + phase).

    Parameters
    ----------
    frequency_hz : float
        Frequency, Hz, above 0.
    amplitude_nm : float
        Amplitude, N m.
    phase_rad : float or None
        Phase at the start of the acquisition, rad; None for a new one in every acquisition,
        because nothing starts in step with the mains.
    """

    frequency_hz: float
    amplitude_nm: float
    phase_rad: float | None

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion; a phase of None counts as 0."""
        angle = 2.0 * math.pi * self.frequency_hz * motion.time_s
        return self.amplitude_nm * np.cos(angle + (self.phase_rad or 0.0))


@dataclass(frozen=True, slots=True)
class GainError:
    """A share of the transmitted torque that reads too much.

    Parameters
    ----------
    fraction : float
        Relative error, 1.
    """

    fraction: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        return self.fraction * motion.transmitted_nm


@dataclass(frozen=True, slots=True)
class ZeroStep:
    """A zero that jumps once in every acquisition.

    Parameters
    ----------
    at_s : float
        Time since the start of the acquisition, s.
    size_nm : float
        Height, N m.
    """

    at_s: float
    size_nm: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        return np.where(motion.time_s >= self.at_s, self.size_nm, 0.0)


@dataclass(frozen=True, slots=True)
class ZeroDrift:
    """A zero that runs away steadily, from 0 at the start of every acquisition.

    Parameters
    ----------
    rate_nm_per_s : float
        Slope, N m/s.
    """

    rate_nm_per_s: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        return self.rate_nm_per_s * np.maximum(motion.time_s, 0.0)


@dataclass(frozen=True, slots=True)
class ToothBump:
    """A damaged tooth: a Gaussian bump at one place of every output turn.

    Parameters
    ----------
    center_rad : float
        Output angle of the tooth, rad.
    width_rad : float
        Standard deviation of the bump on the output angle, rad, above 0.
    height_nm : float
        Height, N m.
    """

    center_rad: float
    width_rad: float
    height_nm: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        away = np.remainder(motion.output_angle_rad - self.center_rad + math.pi, 2.0 * math.pi)
        return self.height_nm * np.exp(-0.5 * ((away - math.pi) / self.width_rad) ** 2)


Effect = (
    OutputFriction
    | MotorOrder
    | OutputOrder
    | Tone
    | GainError
    | ZeroStep
    | ZeroDrift
    | ToothBump
    | AsymmetricFriction
    | Cogging
    | TransmissionError
)


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
