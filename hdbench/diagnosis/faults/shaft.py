"""Angle and velocity of one shaft: increments by both, and whether one was made of the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, uniform_filter1d

from hdbench.diagnosis.faults.scatter import least_squares, robust_std, smallest_step
from hdbench.diagnosis.faults.stamps import gap_steps
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = [
    "ANGLES", "VELOCITIES", "Shaft", "angle_of", "derivation", "disagreement",
    "has_own_noise", "scaled", "shaft_of", "velocity_of",
]  # fmt: skip

ANGLES = ("motor_angle_rad", "encoder_count")
VELOCITIES = ("motor_velocity_rad_s", "tacho_v")
# samples of a stretch that decides, and samples over which a filter of it may reach
_STRETCH, _LAGS = 16384, 60
# samples of the running mean that takes the motion out: what is left is the channels' own
_FAST = 5
# share of the fast part of one channel that the other explains where it was made of it; of
# channels with noise of their own it is next to 0
_MADE_OF = 0.5
# an integrated angle holds nothing but the velocity
_INTEGRATED = 0.99
# noise of its own that a velocity has to show, over that of its rounding
_OWN = 2.0
# even steps have to fit this much better than the stamps
_BETTER = 0.8
# rounds in which what stands out of the noise is left out of the fit, and its limit
_ROUNDS = 3
_TRIM = 5.0
# share of the increments that no jump touches
_USUAL = 0.95


@dataclass(frozen=True, slots=True)
class Shaft:
    """Motor angle and velocity side by side.

    `moves_rad` are the n - 1 increments of the angle, `good` those between present neighbours
    without a gap, `steps_s` the times between the samples: those of the stamps, or even ones where
    the shaft says that the sampling was even and the stamps were not. `count_rad` is the angle's
    smallest step, `names` are angle and velocity.
    """

    time_s: FloatArray
    steps_s: FloatArray
    angle_rad: FloatArray
    velocity_rad_s: FloatArray
    moves_rad: FloatArray
    good: NDArray[np.bool_]
    count_rad: float
    names: tuple[str, str]

    @property
    def period_s(self) -> float:
        """Median sampling period, s."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def pace_rad_s(self) -> FloatArray:
        """Mean velocity between neighbouring samples, rad/s."""
        return np.asarray(0.5 * (self.velocity_rad_s[1:] + self.velocity_rad_s[:-1]))


def velocity_of(trace: Trace, profile: ProfileData) -> FloatArray | None:
    """Return the measured motor velocity, rad/s; None where there is none."""
    if "motor_velocity_rad_s" in trace:
        return trace["motor_velocity_rad_s"]
    return trace["tacho_v"] * profile.tacho.gain_rad_s_per_v if "tacho_v" in trace else None


def angle_of(trace: Trace, profile: ProfileData) -> FloatArray | None:
    """Return the measured motor angle, rad; None where there is none."""
    if "motor_angle_rad" in trace:
        return trace["motor_angle_rad"]
    count = 2.0 * np.pi / profile.encoder.counts_per_turn
    return trace["encoder_count"] * count if "encoder_count" in trace else None


def shaft_of(trace: Trace, profile: ProfileData) -> Shaft | None:
    """Return angle and velocity side by side; None where one is missing."""
    angle, velocity = angle_of(trace, profile), velocity_of(trace, profile)
    if angle is None or velocity is None:
        return None
    moves, steps = np.diff(angle), np.diff(trace.time_s)
    pace = 0.5 * (velocity[1:] + velocity[:-1])
    good = np.isfinite(moves) & np.isfinite(pace)
    good[gap_steps(trace.time_s)] = False
    even = np.where(good, float(np.median(steps)), steps)
    off = [float(np.sum(np.abs(moves - pace * one)[good])) for one in (steps, even)]
    steps = even if off[1] < _BETTER * off[0] else steps
    angle_name, velocity_name = (
        next(name for name in some if name in trace) for some in (ANGLES, VELOCITIES)
    )
    return Shaft(
        trace.time_s, steps, angle, velocity, moves, good, smallest_step(moves),
        (angle_name, velocity_name),
    )  # fmt: skip


def scaled(trace: Trace, names: tuple[str, ...], factor: FloatArray | float) -> Trace:
    """Return the trace with those of the named channels that it has times a factor."""
    columns = {name: np.asarray(trace[name] * factor) for name in names if name in trace}
    return trace.with_columns(**columns)


def _filled(values: FloatArray) -> FloatArray:
    """Return values with a straight line over what is lost."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return np.nan_to_num(values)
    at = np.arange(len(values))
    return np.interp(at, at[known], values[known])


def disagreement(shaft: Shaft) -> FloatArray:
    """Return increments of the angle that the velocity does not explain, rad.

    Gain, offset and lag of the velocity are none.
    """
    good, wanted, steps = shaft.good, shaft.moves_rad, shaft.steps_s
    left = np.zeros(len(good))
    velocity = _filled(shaft.velocity_rad_s)
    design = np.column_stack([_filled(shaft.pace_rad_s) * steps, np.diff(velocity), steps])
    off = np.abs(wanted - shaft.pace_rad_s * steps)
    used = good & (off <= _TRIM * float(np.quantile(off[good], _USUAL)))
    for _ in range(_ROUNDS):
        solution = least_squares(design[used], wanted[used])
        left[good] = wanted[good] - design[good] @ solution
        limit = max(_TRIM * robust_std(left[good]), 2.0 * shaft.count_rad)
        used = good & (np.abs(left) <= limit)
    return left


def _explained(wanted: FloatArray, source: FloatArray, good: NDArray[np.bool_], lags: int) -> float:
    """Return the share of the fast part of `wanted` that a free filter of `source` explains.

    The filter takes from `lags` samples before each and one after it; the busiest stretch decides.
    """
    spans = np.concatenate([[0.0], np.cumsum(np.abs(source))])
    size = min(_STRETCH, len(source))
    if size < 8 * (lags + 2):
        return 0.0
    first = int(np.argmax(spans[size:] - spans[:-size]))
    part = slice(first, first + size)
    fast = [one - uniform_filter1d(one, _FAST) for one in (wanted[part], source[part])]
    columns = np.lib.stride_tricks.sliding_window_view(fast[1], lags + 2)
    response = fast[0][lags:-1]
    whole = ~binary_dilation(~good[part], iterations=_FAST)[lags:-1]
    # a few samples that stand out decide nothing
    kept = whole & (np.abs(response) <= _TRIM * max(robust_std(response), 1e-300))
    response, columns = response[kept], columns[kept]
    power = float(response @ response)
    if not power > 0.0 or len(response) < 4 * (lags + 2):
        return 0.0
    left = response - columns @ least_squares(columns, response)
    return 1.0 - float(left @ left) / power


def has_own_noise(shaft: Shaft) -> bool:
    """Return whether the velocity shows noise above its rounding.

    Where it does not, nobody can see whether it is a sensor of its own.
    """
    velocity = _filled(shaft.velocity_rad_s)
    fast = robust_std(velocity - uniform_filter1d(velocity, _FAST))
    rounding = smallest_step(shaft.velocity_rad_s) / float(np.sqrt(12.0))
    return fast > _OWN * rounding


def derivation(shaft: Shaft) -> tuple[str, str] | None:
    """Return (channel, channel that it was made of), or None for two sensors.

    What is fast in a channel is its own noise and rounding. Where the other channel explains it,
    both come from one sensor: an integrated velocity, or a differentiated and filtered angle.
    """
    steps, good, velocity = shaft.steps_s, shaft.good, _filled(shaft.velocity_rad_s)
    moves = _filled(np.where(good, shaft.moves_rad, np.nan))
    angle, tacho = shaft.names
    if _explained(moves, velocity[1:] * steps, good, 1) > _INTEGRATED:
        return angle, tacho
    if _explained(velocity[1:], moves / steps, good, _LAGS) > _MADE_OF:
        return tacho, angle
    return None
