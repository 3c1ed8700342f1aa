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
# what is left of a command after so many time constants is rounding; a servo that is slower than so
# many samples is followed step by step
_FADED, _MOST_TAPS = 40.0, 1000


def planned_trace(plan: MotionPlan, profile: ProfileData) -> Trace:
    r"""Return the ideal record of a plan: what a bench without noise would measure.

    Parameters
    ----------
    plan : MotionPlan
        A plan within the limits.
    profile : ProfileData
        Servo, sampling period, gear ratio.

    Returns
    -------
    Trace
        Time, reference, velocity, both angles, load, and the current of a motor without friction; a
        minute passes at each load step.

    Raises
    ------
    UsageError
        If the plan has no segment or more samples than can be simulated.

    Notes
    -----
    The velocity follows the reference through :math:`\dot\omega = \mathrm{clip}(2 \pi f_b
    (k u - \omega), \pm\alpha_{max})`, solved in closed form over every sampling period but for
    the one in which the limit is left. While the wave generator is locked the output stands at the
    step's position and the motor angle at N times that, as for readings of a calibration.
    """
    period = profile.daq.sample_period_s
    stages = plan_stages(plan)
    count = sum(s.duration_s for s in stages) / period
    if not 5.0 <= count <= _MAX_SAMPLES:
        raise UsageError(
            f"{count:.6g} samples in the plan; needed: 5 to {_MAX_SAMPLES}",
            where="the plan",
            fix="change its duration",
        )
    start_s, angle = 0.0, 0.0
    pieces: list[dict[str, FloatArray]] = []
    for index, stage in enumerate(stages):
        start_s += _OPERATOR_S if index else 0.0
        piece = _stage_columns(stage, profile, start_s, angle)
        pieces.append(piece)
        start_s = float(piece["time_s"][-1]) + period
        if not (stage.load is not None and stage.load.locked):
            angle = float(piece["motor_angle_rad"][-1])
    columns = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    return Trace(columns, f"plan {plan.name}")


def planned_motion(plan: MotionPlan, profile: ProfileData) -> Motion:
    """Return the motion of a plan, formed as for a measured record.

    Parameters
    ----------
    plan : MotionPlan
        Plan.
    profile : ProfileData
        Bench.

    Returns
    -------
    Motion
    """
    return motion_from_trace(planned_trace(plan, profile), profile)


def _stage_columns(
    stage: Stage, profile: ProfileData, start_s: float, angle_rad: float
) -> dict[str, FloatArray]:
    """Return the columns of one acquisition that starts at a time and a motor angle."""
    period, ratio = profile.daq.sample_period_s, profile.drive.gear_ratio
    volts = program_voltage(program_of(stage, profile), period)
    n = len(volts)
    load = stage.load
    velocity, travelled = _servo(profile, volts)
    angle = angle_rad + travelled
    if load is not None and load.locked:
        angle = np.full(n, ratio * load.position_rad)
    torque = 0.0 if load is None else load.torque_nm
    servo = profile.servo
    per_acceleration = servo.max_current_a / servo.max_acceleration_rad_s2
    held = torque / (ratio * servo.torque_constant_nm_per_a)
    current = per_acceleration * np.gradient(velocity, period) + (
        0.0 if load is not None and load.locked else held
    )
    return {
        "time_s": start_s + period * np.arange(n, dtype=np.float64),
        "reference_v": volts,
        "motor_velocity_rad_s": velocity,
        "motor_angle_rad": angle,
        "output_angle_rad": angle / ratio,
        "load_torque_nm": np.full(n, torque),
        "motor_current_a": current,
    }


def _servo(profile: ProfileData, volts: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return velocity, rad/s, and angle travelled, rad, at every sample."""
    period, servo = profile.daq.sample_period_s, profile.servo
    rate, most = 2.0 * math.pi * servo.bandwidth_hz, servo.max_acceleration_rad_s2
    decay = math.exp(-rate * period)
    target = servo.velocity_gain_rad_s_per_v * volts
    # below the limit of acceleration each command fades away like any other: one convolution
    taps = min(len(volts), math.ceil(_FADED / (rate * period)))
    if taps <= _MOST_TAPS:
        response = -math.expm1(-rate * period) * decay ** np.arange(taps)
        velocity = np.concatenate([[0.0], np.convolve(target, response)[: len(target) - 1]])
        gap = target - velocity
        if float(np.abs(gap).max()) * rate <= most:
            steps = target * period - gap * (1.0 - decay) / rate
            return velocity, np.concatenate([[0.0], np.cumsum(steps[:-1])])
    velocity, angle = np.empty(len(volts)), np.empty(len(volts))
    now, turned = 0.0, 0.0
    for index, wanted in enumerate(target.tolist()):
        velocity[index], angle[index] = now, turned
        away = wanted - now
        if abs(away) * rate <= most:
            turned += wanted * period - away * (1.0 - decay) / rate
            now += (1.0 - decay) * away
        else:
            step = math.copysign(min(most * period, abs(away)), away)
            turned += (now + 0.5 * step) * period
            now += step
    return velocity, angle
