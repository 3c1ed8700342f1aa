"""Time, velocity and angle of the samples: the motion part of the filter's state, in Python."""

from __future__ import annotations

import math

import numpy as np

from hdbench.filter.layout import (
    ACCELERATION,
    ANGLE,
    HAS_ANGLE,
    HAS_VELOCITY,
    HEADER,
    SEEN,
    TIME,
    USABLE,
    VELOCITY,
    VELOCITY_TIME,
)
from hdbench.records import FloatArray

__all__ = ["first_bad_time", "observe"]


def first_bad_time(state: FloatArray, time_s: FloatArray) -> int:
    """Return the first sample whose time does not increase."""
    before = np.concatenate(([state[TIME] if state[SEEN] else -math.inf], time_s[:-1]))
    bad = ~(np.isfinite(time_s) & (time_s > before[: time_s.size]))
    return int(np.argmax(bad)) if bad.any() else -1


def observe(
    state: FloatArray,
    model: FloatArray,
    motion: tuple[FloatArray, FloatArray, FloatArray | None],
    expected: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Advance the motion part of a state over time, velocity and angle."""
    inertia, ratio, constant = model[3:6].tolist()
    values: list[float] = state[:HEADER].tolist()
    times, velocities = motion[0].tolist(), motion[1].tolist()
    angles = [math.nan] * len(times) if motion[2] is None else motion[2].tolist()
    turns, periods = [], []
    for k, (time, velocity, angle) in enumerate(zip(times, velocities, angles, strict=True)):
        periods.append(time - values[TIME] if values[SEEN] else 0.0)
        turns.append(_turn(values, time, angle))
        _accelerate(values, time, velocity, 2.0 * constant)
        expected[k] = inertia / ratio * values[ACCELERATION]
    state[:HEADER] = values
    return np.array(turns), np.array(periods)


def _turn(values: list[float], time: float, angle: float) -> float:
    turned = 0.0
    if values[SEEN] and values[HAS_VELOCITY]:
        turned = values[VELOCITY] * (time - values[TIME])
    if abs(angle) <= USABLE:
        if values[HAS_ANGLE]:
            turned = angle - values[ANGLE]
        values[ANGLE], values[HAS_ANGLE] = angle, 1.0
    elif values[HAS_ANGLE]:
        values[ANGLE] += turned
    values[SEEN], values[TIME] = 1.0, time
    return turned if math.isfinite(turned) else 0.0


def _accelerate(values: list[float], time: float, velocity: float, two_t: float) -> None:
    """Difference the velocity by Tustin with the true period; hold where it is missing."""
    if not abs(velocity) <= USABLE:
        return
    if values[HAS_VELOCITY]:
        dt = time - values[VELOCITY_TIME]
        scale = 1.0 / (two_t + dt)
        values[ACCELERATION] = (
            2.0 * scale * (velocity - values[VELOCITY])
            + (two_t - dt) * scale * values[ACCELERATION]
        )
    values[HAS_VELOCITY] = 1.0
    values[VELOCITY], values[VELOCITY_TIME] = velocity, time
