"""Causes that act through the inertia of the load or a resonance of the drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hdbench.model.causes._memory import even_step, remembered, resonance
from hdbench.model.causes._needs import all_of, motor_turns, output_turns, speed_varies
from hdbench.model.causes._parts import lobe_angle, no_shape, pair, pair_parameters
from hdbench.model.definition import Cause, Parameter
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

__all__ = ["KINEMATIC_ERROR", "TORSIONAL_RESONANCE", "TRANSMISSION_ERROR", "angle_error_rad"]

# harmonics of the motor angle in a harmonic drive's transmission error, each twice the last
_HARMONICS = (1.0, 2.0, 4.0)
# 10 rad of the output: a linear fit that says nothing may give anything below it
_ANGLE_LIMIT_RAD = 10.0
_RESONANCE = Parameter("resonance_hz", "Hz", 20.0, 450.0, "natural frequency, w_r / 2 pi")
_DAMPING = Parameter("damping", "1", 0.005, 0.3, "damping ratio, zeta")


def _kinematic(motion: Motion) -> FloatArray:
    inertia = motion.inertia_nm_s2 * motion.gear_ratio
    centripetal = -inertia * motion.velocity_rad_s**2
    tangential = inertia * motion.acceleration_rad_s2
    columns = np.empty((len(motion), 2 * len(_HARMONICS)))
    cosine, sine = np.cos(motion.angle_rad), np.sin(motion.angle_rad)
    for place, k in enumerate(_HARMONICS):
        if place:
            # each harmonic is twice the one before
            cosine, sine = cosine * cosine - sine * sine, 2.0 * sine * cosine
        columns[:, 2 * place] = k * k * centripetal * cosine - k * tangential * sine
        columns[:, 2 * place + 1] = k * k * centripetal * sine + k * tangential * cosine
    return columns


def _has_inertia(motion: Motion) -> str | None:
    if motion.inertia_nm_s2 > 0.0:
        return None
    return "the load has no inertia here; needed: load_inertia_kg_m2 of the profile, kg m^2"


def _transmission(motion: Motion) -> FloatArray:
    errors = _angle_errors(motion)
    slope = motion.ripple_slope_nm_per_rad
    return np.zeros_like(errors) if slope is None else -slope[:, None] * errors


def _angle_errors(motion: Motion) -> FloatArray:
    output = motion.output_angle_rad
    waves = [pair(angle) for angle in (motion.angle_rad, output, 2.0 * output)]
    return np.column_stack([*waves, motion.applied_nm])


def angle_error_rad(motion: Motion, linear: Sequence[float]) -> FloatArray:
    """Return the error of the recorded motor angle that a transmission error says."""
    return np.asarray(np.nan_to_num(_angle_errors(motion) @ np.asarray(linear)))


def _has_ripple(motion: Motion) -> str | None:
    slope = motion.ripple_slope_nm_per_rad
    if slope is not None and bool(np.any(slope[motion.valid] != 0.0)):
        return None
    return "the simulated torque does not follow the motor angle; needed: a ripple in the model"


def _resonance(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    phase = lobe_angle(motion)
    at, starts = remembered(motion, phase)
    time, phase, damping = motion.time_s[at], phase[at], shape["damping"]
    pole = 2.0 * np.pi * shape["resonance_hz"] * complex(-damping, np.sqrt(1.0 - damping**2))
    step = np.diff(time, prepend=time[:1])
    even = even_step(time, starts, pole)
    decay = np.exp(pole * (step if even is None else np.array([even])))
    rate = np.diff(phase, prepend=phase[:1]) / np.where(step > 0.0, step, 1.0)
    begins = np.flatnonzero(starts)
    # a start is the steady state of the rate that follows it
    rate[begins] = rate[np.minimum(begins + 1, len(rate) - 1)] if len(rate) else 0.0
    once = np.empty(len(phase), dtype=np.complex128)
    once.real, once.imag = np.cos(phase), np.sin(phase)
    columns = np.full((len(motion), 4), np.nan)
    for place, (wave, multiple) in enumerate(((once, 1.0), (once * once, 2.0))):
        response = resonance(wave, multiple * rate, decay, starts, pole)
        columns[at, 2 * place], columns[at, 2 * place + 1] = response.real, response.imag
    return columns


TORSIONAL_RESONANCE = Cause(
    name="torsional-resonance",
    equation="H applied to A2 cos(2 G theta_m + phase2) + A4 cos(4 G theta_m + phase4), "
    "H = w_r^2 / (s^2 + 2 zeta w_r s + w_r^2)",
    shape=(_RESONANCE, _DAMPING),
    linear=(
        *pair_parameters("the ripple of order 2 before the resonance", "_2"),
        *pair_parameters("the ripple of order 4 before the resonance", "_4"),
    ),
    locked_to="motor",
    parity="amplitude peaks, and phase turns by 180 degrees, at one rate in Hz",
    channel="mechanical",
    look_alikes=("kinematic-error", "structural-tone", "ripple-harmonic"),
    experiment="a slow sweep of speed up and down, through the resonance at order 2 and order 4",
    source="second-order resonance of load and flexspline; Tuttle 1992, MIT AITR-1365",
    columns=_resonance,
    harmonic=False,
    applicable=all_of(motor_turns(1.0), speed_varies),
)
KINEMATIC_ERROR = Cause(
    name="kinematic-error",
    equation="J d^2 e / dt^2, e = sum over k = 1, 2, 4 of A_k cos(k theta_m + phase_k)",
    shape=(),
    linear=tuple(
        Parameter(
            f"{part}_{k:g}_rad",
            "rad",
            -_ANGLE_LIMIT_RAD,
            _ANGLE_LIMIT_RAD,
            f"{part} part of the output angle's error, {k:g} per motor turn",
        )
        for k in _HARMONICS
        for part in ("cosine", "sine")
    ),
    locked_to="motor",
    parity="even in speed: grows with speed squared",
    channel="kinematic",
    look_alikes=("torsional-resonance", "ripple-harmonic", "motor-unbalance"),
    experiment="four to six constant speeds over at least 1:4; a second encoder at the output",
    source="Ghorbel, Gandhi, Alpeter 2001, J. Mech. Des. 123:90: theta_o = theta_m / N + e",
    columns=no_shape(_kinematic),
    harmonic=False,
    applicable=all_of(motor_turns(1.0), _has_inertia),
)
TRANSMISSION_ERROR = Cause(
    name="transmission-error",
    equation="-e dy/d theta_m, y the torque in the channel, recorded angle = theta_m + e, e = "
    "A_m cos(theta_m + phase_m) + A_1 cos(theta_o + phase_1) + A_2 cos(2 theta_o + phase_2) "
    "+ c T, T the known torque; dy/d theta_m over the whole way e",
    shape=(),
    linear=(
        *(
            Parameter(
                f"{part}_{place}_rad",
                "rad",
                -_ANGLE_LIMIT_RAD,
                _ANGLE_LIMIT_RAD,
                f"{part} part of the recorded motor angle's error, {often}",
            )
            for place, often in (
                ("motor", "once per motor turn"),
                ("output_1", "once per output turn"),
                ("output_2", "twice per output turn"),
            )
            for part in ("cosine", "sine")
        ),
        Parameter(
            "windup_rad_per_nm",
            "rad/(N m)",
            -_ANGLE_LIMIT_RAD,
            _ANGLE_LIMIT_RAD,
            "change of the recorded motor angle with the known torque: an encoder behind a spring",
        ),
    ),
    locked_to="motor",
    parity="side lines of every strong order, in proportion to the order and its amplitude",
    channel="kinematic",
    look_alikes=("ripple-beat", "load-dependent-ripple", "encoder-slip"),
    experiment="a second encoder at the motor; one error explains the side lines of all orders",
    source="first term of the ripple in powers of the angle's error; Ghorbel, Gandhi, Alpeter 2001",
    columns=no_shape(_transmission),
    harmonic=False,
    applicable=all_of(output_turns(1.0), _has_ripple),
    whole_signal=True,
)
