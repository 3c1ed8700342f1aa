"""Motor with servo amplifier: a first-order velocity loop at its acceleration limit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdbench.profile.schema import ProfileData, Servo
from hdbench.records.trace import FloatArray


@dataclass(frozen=True, slots=True)
class HoldMotion:
    """Exact motion over holds of the reference, on a grid within each hold."""

    angle_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray
    start_angle_rad: FloatArray
    start_velocity_rad_s: FloatArray


@dataclass(frozen=True, slots=True)
class ServoLoop:
    r"""Velocity loop :math:`\dot v = \mathrm{clip}(k (v_c - v), \pm a_{max})`.

    Over a constant command the solution is closed: with :math:`d = |v_c - v_0|`,
    :math:`s` its sign and :math:`e = \min(d, a_{max} / k)` the speed runs along the ramp
    :math:`v_0 + s a_{max} t` until :math:`t_1 = (d - e) / a_{max}`, then along
    :math:`v_c - s e \exp(-k (t - t_1))`. The angle is its integral. There is no integration error.
    """

    rate_per_s: float
    max_acceleration_rad_s2: float

    def run(
        self,
        command_rad_s: FloatArray,
        step_s: float,
        n_steps: int,
        start: tuple[float, float, float],
    ) -> HoldMotion:
        """Return the motion over holds of `n_steps` steps each."""
        angles, speeds = self._starts(command_rad_s, step_s * n_steps, start[:2])
        elapsed = np.arange(n_steps) * step_s
        command = command_rad_s[:, None]
        k, limit = self.rate_per_s, self.max_acceleration_rad_s2
        gap = command - speeds[:-1, None]
        sign = np.sign(gap)
        tail = np.minimum(np.abs(gap), limit / k)
        ramp_s = (np.abs(gap) - tail) / limit
        on_ramp = np.minimum(elapsed, ramp_s)
        after = elapsed - on_ramp
        left = sign * tail * np.exp(-k * after)
        angle = (
            angles[:-1, None]
            + speeds[:-1, None] * on_ramp
            + 0.5 * sign * limit * on_ramp**2
            + command * after
            - (sign * tail - left) / k
        )
        ramping = elapsed < ramp_s
        velocity = np.where(ramping, speeds[:-1, None] + sign * limit * elapsed, command - left)
        acceleration = np.where(ramping, sign * limit, k * left)
        earlier = np.concatenate(([start[2]], command_rad_s[:-1]))
        arriving = np.clip(k * (earlier - speeds[:-1]), -limit, limit)
        acceleration[:, 0] = 0.5 * (acceleration[:, 0] + arriving)
        return HoldMotion(angle, velocity, acceleration, angles, speeds)

    def _starts(
        self, command_rad_s: FloatArray, hold_s: float, start: tuple[float, float]
    ) -> tuple[FloatArray, FloatArray]:
        """Return angle and speed at the start of every hold and at the end of the last."""
        angle, speed = start
        k, limit = self.rate_per_s, self.max_acceleration_rad_s2
        decay = math.exp(-k * hold_s)
        angles, speeds = [angle], [speed]
        for command in command_rad_s.tolist():
            gap = command - speed
            if -limit <= k * gap <= limit:
                left = gap * decay
                angle += command * hold_s - (gap - left) / k
            else:
                angle, left = self._ramp(angle, command, speed, hold_s)
            speed = command - left
            angles.append(angle)
            speeds.append(speed)
        return np.array(angles), np.array(speeds)

    def _ramp(
        self, angle: float, command: float, speed: float, hold_s: float
    ) -> tuple[float, float]:
        """Return angle and remaining speed difference after a hold that starts at the limit."""
        k, limit = self.rate_per_s, self.max_acceleration_rad_s2
        gap = command - speed
        sign = math.copysign(1.0, gap)
        ramp_s = min((abs(gap) - limit / k) / limit, hold_s)
        angle += speed * ramp_s + 0.5 * sign * limit * ramp_s**2
        gap -= sign * limit * ramp_s
        rest_s = hold_s - ramp_s
        left = gap * math.exp(-k * rest_s)
        return angle + command * rest_s - (gap - left) / k, left


def servo_loop(servo: Servo) -> ServoLoop:
    """Return the velocity loop of a profile."""
    return ServoLoop(2.0 * math.pi * servo.bandwidth_hz, servo.max_acceleration_rad_s2)


def command_rad_s(profile: ProfileData, reference_v: FloatArray) -> FloatArray:
    """Return the commanded motor speed."""
    limit = profile.limits.velocity_rad_s
    return np.clip(reference_v * profile.servo.velocity_gain_rad_s_per_v, -limit, limit)


def motor_current_a(
    servo: Servo, acceleration_rad_s2: FloatArray, friction_nm: FloatArray
) -> FloatArray:
    """Return the motor current that the motion needs.

    i = (J a + friction) / K_t with J = K_t i_max / a_max: the profile gives the acceleration at the
    current limit, which fixes the inertia that the motor feels, load and rotor together.
    """
    per_acceleration = servo.max_current_a / servo.max_acceleration_rad_s2
    current = per_acceleration * acceleration_rad_s2 + friction_nm / servo.torque_constant_nm_per_a
    return np.clip(current, -servo.max_current_a, servo.max_current_a)
