"""The motion that a plan will give: reference through the servo, with the loads of its steps."""

from __future__ import annotations

import math

import numpy as np

from hdbench.diagnosis.planning.segments import MotionPlan, Stage, plan_stages, program_of
from hdbench.errors import UsageError
from hdbench.model import Motion, motion_from_trace
from hdbench.model.program import program_voltage
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = ["planned_motion", "planned_trace"]

# time that a person takes to hang a weight and step back; only slow effects notice its length
_OPERATOR_S = 60.0
# samples of a plan that still fit a gigabyte with everything that is computed from them
_MAX_SAMPLES = 2_000_000


def planned_trace(plan: MotionPlan, profile: ProfileData) -> Trace:
    r"""Return the record of a plan within the limits that a bench without noise would measure.

    The velocity follows the reference through :math:`\dot\omega = \mathrm{clip}(2 \pi f_b
    (k u - \omega), \pm\alpha_{max})`, solved in closed form over every sampling period but for
    the one in which the limit is left. While the wave generator is locked the output stands at the
    step's position and the motor angle at N times that, as for readings of a calibration. The
    current is that of a motor without friction.
    """
    period = profile.daq.sample_period_s
    count = plan.duration_s / period
    if not 5.0 <= count <= _MAX_SAMPLES:
        raise UsageError(
            f"{count:.6g} samples in the plan; needed: 5 to {_MAX_SAMPLES}",
            where="the plan",
            fix="change its duration",
        )
    start_s, angle = 0.0, 0.0
    pieces: list[dict[str, FloatArray]] = []
    for stage in plan_stages(plan):
        piece = _stage_columns(stage, profile, start_s, angle)
        pieces.append(piece)
        start_s = float(piece["time_s"][-1]) + period + _OPERATOR_S
        if not (stage.load is not None and stage.load.locked):
            angle = float(piece["motor_angle_rad"][-1])
    columns = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    return Trace(columns, f"plan {plan.name}")


def planned_motion(plan: MotionPlan, profile: ProfileData) -> Motion:
    """Return the motion of a plan, formed as for a measured record."""
    return motion_from_trace(planned_trace(plan, profile), profile)


def _stage_columns(
    stage: Stage, profile: ProfileData, start_s: float, angle_rad: float
) -> dict[str, FloatArray]:
    """Return the columns of one acquisition that starts at a time and a motor angle."""
    period, ratio, servo = profile.daq.sample_period_s, profile.drive.gear_ratio, profile.servo
    volts = program_voltage(program_of(stage, profile), period)
    velocity, travelled = _servo(profile, volts)
    angle, torque, held = angle_rad + travelled, 0.0, 0.0
    if stage.load is not None:
        torque = stage.load.torque_nm
        if stage.load.locked:
            angle = np.full(len(volts), ratio * stage.load.position_rad)
        else:
            held = torque / (ratio * servo.torque_constant_nm_per_a)
    per_acceleration = servo.max_current_a / servo.max_acceleration_rad_s2
    return {
        "time_s": start_s + period * np.arange(len(volts), dtype=np.float64),
        "reference_v": volts,
        "motor_velocity_rad_s": velocity,
        "motor_angle_rad": angle,
        "output_angle_rad": angle / ratio,
        "load_torque_nm": np.full(len(volts), torque),
        "motor_current_a": per_acceleration * np.gradient(velocity, period) + held,
    }


def _servo(profile: ProfileData, volts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return velocity, rad/s, and angle travelled, rad, at every sample."""
    period, servo = profile.daq.sample_period_s, profile.servo
    rate, most = 2.0 * math.pi * servo.bandwidth_hz, servo.max_acceleration_rad_s2
    reached = -math.expm1(-rate * period)
    velocity, angle = list[float](), list[float]()
    now, turned = 0.0, 0.0
    for wanted in (servo.velocity_gain_rad_s_per_v * volts).tolist():
        velocity.append(now)
        angle.append(turned)
        away = wanted - now
        if abs(away) * rate <= most:
            turned += wanted * period - away * reached / rate
            now += reached * away
        else:
            step = math.copysign(min(most * period, abs(away)), away)
            turned += (now + 0.5 * step) * period
            now += step
    return np.array(velocity), np.array(angle)
