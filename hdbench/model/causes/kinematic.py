"""Causes of the angle: errors of the transmission, and the resonance of the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hdbench.model.causes import _parts as parts
from hdbench.model.causes._memory import even_step, remembered, resonance
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

TRANSMISSION_ERROR = "transmission-error"

# harmonics of the motor angle in a harmonic drive's transmission error, each twice the last
_HARMONICS = (1.0, 2.0, 4.0)
# times that the error of an angle is formed over the angle without it: each time is some hundred
# times nearer
_TURNS = 3


def _kinematic(motion: Motion, _: parts.Shape) -> FloatArray:
    inertia = motion.inertia_nm_s2 * motion.gear_ratio
    columns = np.empty((len(motion), 2 * len(_HARMONICS)))
    cosine, sine = np.cos(motion.angle_rad), np.sin(motion.angle_rad)
    for place, k in enumerate(_HARMONICS):
        if place:
            # each harmonic is twice the one before
            cosine, sine = cosine * cosine - sine * sine, 2.0 * sine * cosine
        columns[:, 2 * place : 2 * place + 2] = _inertial(inertia, k, cosine, sine, motion)
    return columns


def _inertial(
    inertia: float, k: float, cosine: FloatArray, sine: FloatArray, motion: Motion
) -> FloatArray:
    """Return an inertia times the second derivatives of cosine and sine of k motor angles."""
    centripetal = -inertia * motion.velocity_rad_s**2
    tangential = inertia * motion.acceleration_rad_s2
    return np.column_stack(
        [
            k * k * centripetal * cosine - k * tangential * sine,
            k * k * centripetal * sine + k * tangential * cosine,
        ]
    )


def _has_inertia(motion: Motion) -> str | None:
    if motion.inertia_nm_s2 > 0.0:
        return None
    return "the load has no inertia here; needed: load_inertia_kg_m2 of the profile, kg m^2"


def _transmission(motion: Motion, _: parts.Shape) -> FloatArray:
    errors = _angle_errors(motion)
    slope = motion.ripple_slope_nm_per_rad
    torque = np.zeros_like(errors) if slope is None else -slope[:, None] * errors
    inertia, shown = motion.inertia_nm_s2, motion.shown_by_angle
    if motion.acceleration_source == "angle" and inertia > 0.0:
        # the expected torque is that of the angle with its error; what a load adds is too slow
        for place, k in ((0, 1.0), (2, 1.0 / motion.gear_ratio), (4, 2.0 / motion.gear_ratio)):
            own, waves = slice(place, place + 2), (errors[:, place], errors[:, place + 1])
            if shown is None:
                torque[:, own] -= _inertial(inertia, k, *waves, motion)
            else:
                torque[:, own] -= inertia * np.column_stack([shown(wave) for wave in waves])
    return torque


def _angle_errors(motion: Motion) -> FloatArray:
    angle, output, error = motion.angle_rad, motion.output_angle_rad, motion.angle_error_rad
    angle = angle if error is None else angle - error
    waves = [parts.pair(a) for a in (angle, output, 2.0 * output)]
    return np.column_stack([*waves, motion.applied_nm])


def angle_error_rad(motion: Motion, linear: Sequence[float]) -> FloatArray:
    """Return the error of the recorded motor angle that a transmission error says."""
    error = np.zeros(len(motion))
    for _ in range(_TURNS):
        # the error stands over the true angle, which it is needed for
        errors = _angle_errors(replace(motion, angle_error_rad=error))
        error = np.asarray(np.nan_to_num(errors @ np.asarray(linear)))
    return error


def _has_ripple(motion: Motion) -> str | None:
    slope = motion.ripple_slope_nm_per_rad
    if slope is not None and bool(np.any(slope[motion.valid] != 0.0)):
        return None
    return "the simulated torque does not follow the motor angle; needed: a ripple in the model"


def _resonance(motion: Motion, shape: parts.Shape) -> FloatArray:
    phase = parts.lobe_angle(motion)
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


COMPUTED = {
    "torsional-resonance": parts.Computed(
        _resonance, parts.all_of(parts.motor_turns(1.0), parts.speed_varies)
    ),
    "kinematic-error": parts.Computed(
        _kinematic, parts.all_of(parts.motor_turns(1.0), _has_inertia)
    ),
    "transmission-error": parts.Computed(
        _transmission, parts.all_of(parts.output_turns(1.0), _has_ripple)
    ),
}
