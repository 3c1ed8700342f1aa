"""Motion that a log covers: speeds, directions, turns, and what they leave open."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hdbench.diagnosis.faults.shaft import ANGLES, VELOCITIES
from hdbench.diagnosis.inspection.log import Log
from hdbench.diagnosis.inspection.result import Coverage, Finding
from hdbench.records.trace import FloatArray

__all__ = ["coverage_of"]

# slower than this part of the greatest speed is rest
_REST = 0.05
# a spread of speeds below this part of their mean is one speed
_ONE = 0.1
# samples that a limit is passed by
_PASSED = 0.01


def coverage_of(log: Log) -> Coverage | None:
    """Return the motion that a log covers."""
    unit, velocity = _velocity(log)
    if velocity is None:
        return None
    velocity = velocity[np.isfinite(velocity)]
    if not len(velocity):
        return None
    low, high = (float(v) for v in np.quantile(velocity, (_PASSED, 1.0 - _PASSED)))
    top = max(abs(low), abs(high))
    moving = velocity[np.abs(velocity) > _REST * top]
    reversals = int(np.count_nonzero(np.diff(np.sign(moving)))) if len(moving) else 0
    angle = log.role("motor_angle_rad")
    turns = None
    if angle is not None and log.units.get(log.roles["motor_angle_rad"]) == "rad":
        turns = float(np.nanmax(angle) - np.nanmin(angle)) / (2.0 * np.pi)
    rest = 1.0 - len(moving) / len(velocity)
    limits = tuple(_limits(np.abs(moving), reversals, turns, unit))
    return Coverage(unit, (low, high), rest, reversals, turns, limits)


def _velocity(log: Log) -> tuple[str, FloatArray | None]:
    role = next((n for n in VELOCITIES if n in log.roles), None)
    if role is not None:
        name = log.roles[role]
        return log.units.get(name, ""), log.channels[name]
    role = next((n for n in ANGLES if n in log.roles), None)
    if role is None or log.time_s is None or len(log) < 2:
        return "", None
    name = log.roles[role]
    steps = np.diff(log.time_s)
    rate = np.diff(log.channels[name])[steps > 0.0] / steps[steps > 0.0]
    unit = log.units.get(name, "")
    return f"{unit}/s" if unit else "", rate


def _limits(
    speeds: FloatArray, reversals: int, turns: float | None, unit: str
) -> Iterator[Finding]:
    if not len(speeds) or not float(speeds.max()) > 0.0:
        yield Finding("at-rest", None, "the shaft does not move", "nothing that turns can be told")
        return
    mean, spread = float(speeds.mean()), float(speeds.std())
    if spread < _ONE * mean:
        yield Finding(
            "one-speed", None, f"{mean:.4g} {unit} throughout".replace("  ", " "),
            "orders and tones of the clock cannot be told apart, nor friction by its speed",
        )  # fmt: skip
    if not reversals:
        yield Finding(
            "no-reversal", None, "one direction only",
            "dry friction cannot be told from a zero, nor one direction from the other",
        )  # fmt: skip
    if turns is not None and turns < 1.0:
        yield Finding(
            "short-travel", None, f"{turns:.3g} motor turns",
            "orders below one per travel cannot be told",
        )  # fmt: skip
