"""Friction of the output side, as the torque sensor sees it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdbench.model.causes._memory import first_order, remembered, spread_out
from hdbench.model.causes._needs import (
    STANDING_RAD_S,
    all_of,
    loaded,
    moves_and_reverses,
    reverses,
    size_of_speed_varies,
    speed_varies,
)
from hdbench.model.causes._parts import Computed, no_shape, single
from hdbench.model.motion import Motion
from hdbench.records.trace import FloatArray

# ends of the catalogue's domains of the transition and of the Stribeck speed
_SLOWEST_RAD_S, _FASTEST_RAD_S = 0.05, 80.0
# samples slower than the Stribeck speed's domain that a record must have to show the effect
_SLOW_SAMPLES = 20


def _coulomb(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    return single(np.tanh(motion.velocity_rad_s / shape["transition_rad_s"]))


def _viscous(motion: Motion) -> FloatArray:
    return single(motion.velocity_rad_s)


def _stribeck(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    velocity = motion.velocity_rad_s
    excess = np.exp(-((velocity / shape["stribeck_rad_s"]) ** 2))
    return single(excess * np.tanh(velocity / shape["transition_rad_s"]))


def _asymmetric(motion: Motion) -> FloatArray:
    size = np.abs(motion.velocity_rad_s)
    return np.column_stack((np.tanh(size / STANDING_RAD_S), size))


def _moves_slowly(motion: Motion) -> str | None:
    speed = np.abs(motion.velocity_rad_s[motion.valid])
    slow = int(((speed > _SLOWEST_RAD_S) & (speed < _FASTEST_RAD_S)).sum())
    if slow >= _SLOW_SAMPLES:
        return None
    return (
        f"{slow} samples move slower than {_FASTEST_RAD_S:g} rad/s; needed: {_SLOW_SAMPLES} to "
        "see friction fall with speed"
    )


def _fall_is_seen(motion: Motion) -> Mapping[str, tuple[float, float]]:
    """Return the Stribeck speeds whose double was reached: there 2 % of the excess is left."""
    largest = float(np.abs(motion.velocity_rad_s[motion.valid]).max(initial=0.0))
    return {"stribeck_rad_s": (0.0, 0.5 * largest)}


def _load_friction(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    direction = np.tanh(motion.velocity_rad_s / shape["transition_rad_s"])
    return single(np.abs(motion.applied_nm) * direction)


def _presliding(motion: Motion, shape: Mapping[str, float]) -> FloatArray:
    at, starts = remembered(motion, motion.angle_rad)
    way = np.diff(motion.angle_rad[at], prepend=motion.angle_rad[at[:1]])
    left = np.where(starts, 0.0, np.exp(-np.abs(way) / shape["breakaway_rad"]))
    speed = motion.velocity_rad_s[at]
    begin = np.where(np.abs(speed) > STANDING_RAD_S, np.sign(speed), 0.0)
    state = first_order(left, np.where(starts, begin, np.sign(way) * (1.0 - left)))
    return single(spread_out(state, at, len(motion)))


COMPUTED = {
    "coulomb-friction": Computed(_coulomb, moves_and_reverses),
    "viscous-friction": Computed(no_shape(_viscous), speed_varies),
    "stribeck-friction": Computed(
        _stribeck, all_of(moves_and_reverses, _moves_slowly), _fall_is_seen
    ),
    "asymmetric-friction": Computed(no_shape(_asymmetric), all_of(reverses, size_of_speed_varies)),
    "load-dependent-friction": Computed(_load_friction, all_of(moves_and_reverses, loaded)),
    "presliding": Computed(_presliding, moves_and_reverses),
}
