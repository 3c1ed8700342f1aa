"""Causes of the acquisition that change what was recorded of the motion, and crosstalk."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from hdbench.model.causes._needs import motor_turns
from hdbench.model.causes._parts import no_column, no_shape, order_parameter, single
from hdbench.model.causes.slow import TIME_LIMIT_S
from hdbench.model.definition import Cause, Parameter
from hdbench.model.kinematics import angle_curvature, integrate_velocity, velocity_slope
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["CROSSTALK", "ENCODER_SLIP", "MISSED_SAMPLES", "TACHO_RIPPLE"]

_STEP_TIME = Parameter("step_time_s", "s", -TIME_LIMIT_S, TIME_LIMIT_S, "time of the fault, t_0")


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


def _without_slip(motion: Motion, shape: Mapping[str, float]) -> Motion:
    slipped = np.where(motion.time_s >= shape["step_time_s"], shape["slip_rad"], 0.0)
    turned = _turned(motion, motion.angle_rad - slipped)
    return _accelerated(turned) if motion.acceleration_source == "angle" else turned


def _with_missed(motion: Motion, shape: Mapping[str, float]) -> Motion:
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


def _without_tacho_ripple(motion: Motion, shape: Mapping[str, float]) -> Motion:
    angle = shape["order"] * motion.angle_rad
    factor = 1.0 + shape["cosine"] * np.cos(angle) + shape["sine"] * np.sin(angle)
    velocity = motion.velocity_rad_s / factor
    changed = replace(motion, velocity_rad_s=velocity)
    if motion.angle_source == "velocity":
        first = motion.angle_rad[0] if len(motion) else 0.0
        changed = _turned(changed, first + integrate_velocity(motion.time_s, velocity)[0])
    return _accelerated(changed) if motion.acceleration_source == "velocity" else changed


def _current(motion: Motion) -> FloatArray:
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


MISSED_SAMPLES = Cause(
    name="missed-samples",
    equation="samples from t_0 on were taken dt later than their time says",
    shape=(_STEP_TIME, Parameter("missed_s", "s", 1e-6, 1e4, "time that is missing, dt")),
    linear=(),
    locked_to="time",
    parity="does not depend on speed or load; all periodic lines jump in phase",
    channel="acquisition",
    look_alikes=("encoder-slip", "time-skew"),
    experiment="the mains or a tone of known frequency as a clock beside the record's own",
    source="a sample counter that lost counts",
    columns=no_column,
    harmonic=False,
    additive=False,
    change_motion=_with_missed,
)
ENCODER_SLIP = Cause(
    name="encoder-slip",
    equation="recorded angle = theta_m + d H(t - t_0)",
    shape=(_STEP_TIME, Parameter("slip_rad", "rad", -1e4, 1e4, "jump of the recorded angle, d")),
    linear=(),
    locked_to="motor",
    parity="only what follows the angle jumps in phase; tones do not",
    channel="kinematic",
    look_alikes=("missed-samples", "ripple-harmonic"),
    experiment="a long run that returns to a mark; the angle against the integral of the tacho",
    source="an encoder on a coupling that slips, or one that loses counts",
    columns=no_column,
    harmonic=False,
    applicable=motor_turns(1.0),
    additive=False,
    change_motion=_without_slip,
)
TACHO_RIPPLE = Cause(
    name="tacho-ripple",
    equation="recorded velocity = w (1 + c cos(order theta_m) + s sin(order theta_m))",
    shape=(
        order_parameter(0.5, 500.0),
        Parameter("cosine", "1", -0.4, 0.4, "cosine part, relative to the velocity, c"),
        Parameter("sine", "1", -0.4, 0.4, "sine part, relative to the velocity, s"),
    ),
    linear=(),
    locked_to="motor",
    parity="proportional to speed; in the tacho channel alone",
    channel="kinematic",
    look_alikes=("kinematic-error", "ripple-harmonic"),
    experiment="constant speed with an encoder: velocity against the slope of the angle",
    source="commutator of a tacho: twice its segments per turn",
    columns=no_column,
    harmonic=False,
    applicable=motor_turns(1.0),
    additive=False,
    change_motion=_without_tacho_ripple,
)
CROSSTALK = Cause(
    name="crosstalk",
    equation="k u, u the motor current",
    shape=(),
    linear=(Parameter("crosstalk_nm_per_a", "N m/A", -1e3, 1e3, "torque per ampere, k"),),
    locked_to="current",
    parity="odd in current",
    channel="acquisition",
    look_alikes=("inertia-error", "gain-error", "coulomb-friction", "side-force"),
    experiment="current into the motor with the output free, then locked; other channels (bending, "
    "axial force) have to be recorded to be told",
    source="coupling of a supply lead into the bridge, proportional to its current",
    columns=no_shape(_current),
    harmonic=False,
    applicable=_has_current,
    channels=("motor_current_a",),
)
