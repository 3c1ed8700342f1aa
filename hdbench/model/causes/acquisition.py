"""Causes of the acquisition: what was recorded of the motion, crosstalk, noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdbench.model.causes._parts import (
    Computed,
    Shape,
    motor_turns,
    no_column,
    single,
    speed_varies,
)
from hdbench.model.motion import Motion, angle_curvature, integrate_velocity, velocity_slope
from hdbench.records.trace import FloatArray


def _turned(motion: Motion, angle: FloatArray) -> Motion:
    """Return the motion with another motor angle, and its output angle where that follows."""
    output = motion.output_angle_rad
    if motion.output_source == "motor":
        output = angle / motion.gear_ratio
    return replace(motion, angle_rad=angle, output_angle_rad=output)


def _accelerated(motion: Motion) -> Motion:
    """Return the motion with the acceleration of its angle or velocity as they stand."""
    if motion.acceleration_source == "angle":
        acceleration = angle_curvature(motion.time_s, motion.angle_rad)
    else:
        acceleration = velocity_slope(motion.time_s, motion.velocity_rad_s)
    return replace(motion, acceleration_rad_s2=acceleration)


def _without_slip(motion: Motion, shape: Shape) -> Motion:
    slipped = np.where(motion.time_s >= shape["step_time_s"], shape["slip_rad"], 0.0)
    turned = _turned(motion, motion.angle_rad - slipped)
    return _accelerated(turned) if motion.acceleration_source == "angle" else turned


def _with_missed(motion: Motion, shape: Shape) -> Motion:
    after = motion.time_s >= shape["step_time_s"]
    if not after.any():
        return motion
    later = replace(motion, time_s=motion.time_s + np.where(after, shape["missed_s"], 0.0))
    later = _accelerated(later)
    if motion.angle_source != "velocity":
        return later
    # an integrated angle lacks what the motor turned while nothing was recorded
    at = max(int(np.argmax(after)) - 1, 0)
    speed = motion.velocity_rad_s[at] if np.isfinite(motion.velocity_rad_s[at]) else 0.0
    return _turned(later, motion.angle_rad + np.where(after, speed * shape["missed_s"], 0.0))


def _without_tacho_ripple(motion: Motion, shape: Shape) -> Motion:
    angle = shape["order"] * motion.angle_rad
    factor = 1.0 + shape["cosine"] * np.cos(angle) + shape["sine"] * np.sin(angle)
    velocity = motion.velocity_rad_s / factor
    changed = replace(motion, velocity_rad_s=velocity)
    if motion.angle_source == "velocity":
        first = motion.angle_rad[0] if len(motion) else 0.0
        changed = _turned(changed, first + integrate_velocity(motion.time_s, velocity)[0])
    return _accelerated(changed) if motion.acceleration_source == "velocity" else changed


def _current(motion: Motion, _: Shape) -> FloatArray:
    if motion.motor_current_a is None:
        return np.full((len(motion), 1), np.nan)
    return single(motion.motor_current_a)


def _has_current(motion: Motion) -> str | None:
    if motion.motor_current_a is None:
        return "the record has no motor_current_a; needed: the motor current, A"
    known = motion.motor_current_a[motion.valid & np.isfinite(motion.motor_current_a)]
    if len(known) and float(np.ptp(known)) > 0.0:
        return None
    return "motor_current_a is constant; needed: a current that changes, A"


COMPUTED = {
    "missed-samples": Computed(no_column, change_motion=_with_missed),
    "encoder-slip": Computed(no_column, motor_turns(1.0), change_motion=_without_slip),
    "tacho-ripple": Computed(no_column, motor_turns(1.0), change_motion=_without_tacho_ripple),
    "crosstalk": Computed(_current, _has_current),
    "quantisation": Computed(no_column),
    "spikes": Computed(no_column),
    "speed-dependent-noise": Computed(no_column, speed_varies),
}
