"""Effects of motor, bearings and encoder: friction by direction, cogging, an angle that is off."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hdbench.plant.truemotion import PlantMotion
from hdbench.records.trace import FloatArray

__all__ = ["AsymmetricFriction", "Cogging", "TransmissionError", "encoder_error_rad"]


@dataclass(frozen=True, slots=True)
class AsymmetricFriction:
    """Friction that the output bearing has more of forward than backward.

    Parameters
    ----------
    coulomb_difference_nm : float
        Dry friction, forward less backward, halved, N m.
    viscous_difference_nm_s_per_rad : float
        Slope over the output speed, forward less backward, halved, N m s/rad.
    transition_rad_s : float
        Output speed at which the dry part has half its level, rad/s, above 0.

    Notes
    -----
    T = coulomb_difference v^2 / (v^2 + transition^2) + viscous_difference abs(v), v the output
    speed: both directions push the torque the same way.
    """

    coulomb_difference_nm: float
    viscous_difference_nm_s_per_rad: float
    transition_rad_s: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        speed = np.abs(motion.output_velocity_rad_s)
        square = speed * speed
        dry = square / (square + self.transition_rad_s**2)
        return self.coulomb_difference_nm * dry + self.viscous_difference_nm_s_per_rad * speed


@dataclass(frozen=True, slots=True)
class Cogging:
    """Torque between the magnets and the slots of the motor.

    Parameters
    ----------
    order : float
        Periods per motor turn, a whole number.
    amplitude_nm : float
        Amplitude of the first harmonic, N m.
    phase_rad : float
        Phase at motor angle 0, rad.
    decay : float
        Each harmonic over the one before, at least 0, below 1.

    Notes
    -----
    With x = order theta_m + phase and r the decay, the sum over k of r^(k - 1) cos(k x) is
    (cos x - r) / (1 - 2 r cos x + r^2).
    """

    order: float
    amplitude_nm: float
    phase_rad: float
    decay: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return the torque, N m, shape of the motion."""
        cosine = np.cos(self.order * motion.motor_angle_rad + self.phase_rad)
        shape = (cosine - self.decay) / (1.0 - 2.0 * self.decay * cosine + self.decay**2)
        return np.asarray(self.amplitude_nm * shape)


@dataclass(frozen=True, slots=True)
class TransmissionError:
    """A recorded motor angle that wanders about that of the wave generator; no torque of its own.

    Parameters
    ----------
    order : float
        Cycles per output turn, above 0; the gear ratio for once per motor turn.
    amplitude_rad : float
        Largest error of the motor angle, rad.
    phase_rad : float
        Phase at output angle 0, rad.
    """

    order: float
    amplitude_rad: float
    phase_rad: float

    def torque_nm(self, motion: PlantMotion) -> FloatArray:
        """Return zeros: the torque is where it was, the angle beside it is not."""
        return np.zeros_like(motion.time_s)

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
