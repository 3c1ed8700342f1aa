"""True motion of the emulated bench, as effects see it."""

from __future__ import annotations

from dataclasses import dataclass

from hdbench.records.trace import FloatArray

__all__ = ["PlantMotion"]


@dataclass(frozen=True, slots=True)
class PlantMotion:
    """True motion of the bench at the integration steps, each array of one shape.

    Parameters
    ----------
    time_s : ndarray
        Time since the start of the acquisition, s; negative before it.
    motor_angle_rad, motor_velocity_rad_s : ndarray
        Wave generator, rad and rad/s.
    output_angle_rad, output_velocity_rad_s : ndarray
        Load, rad and rad/s (motor over gear ratio).
    transmitted_nm : ndarray
        Torque through the flexspline before any effect, N m.
    """

    time_s: FloatArray
    motor_angle_rad: FloatArray
    motor_velocity_rad_s: FloatArray
    output_angle_rad: FloatArray
    output_velocity_rad_s: FloatArray
    transmitted_nm: FloatArray
