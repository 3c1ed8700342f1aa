"""Angle and velocity of one shaft: increments by both, and whether one was made of the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, uniform_filter1d

from hdbench.diagnosis.faults.fault import robust_std
from hdbench.diagnosis.faults.stamps import gap_steps
from hdbench.profile.schema import ProfileData
from hdbench.records.trace import FloatArray, Trace

__all__ = [
    "ANGLES", "DELAYS", "REACH", "VELOCITIES", "Shaft", "angle_of", "derivation", "disagreement",
    "has_own_noise", "scaled", "shaft_of", "velocity_of",
]  # fmt: skip

ANGLES = ("motor_angle_rad", "encoder_count")
VELOCITIES = ("motor_velocity_rad_s", "tacho_v")
# rounding of an angle, rad: far below any encoder, far above 8-byte numbers
_DECIMALS = 9
# edges of the cells of samples over which a velocity is weighed freely: the trapezoidal rule, and
# any filter of up to some 15 samples on each side
_EDGES = (-15, -7, -3, -1, 0, 1, 2, 4, 8, 16)
# samples from which such a filter takes
REACH = 16
# delays of the velocity that are tried, samples
DELAYS = 40
# samples of a stretch that decides, and samples over which a filter of it may reach
_STRETCH, _LAGS = 16384, 60
# samples of the running mean that takes the motion out: what is left is the channels' own
_FAST = 5
# share of the fast part of one channel that the other explains where it was made of it; of
# channels with noise of their own it is next to 0
_MADE_OF = 0.5
# noise of its own that a velocity has to show, over that of its rounding
_OWN = 2.0
# a tacho lags by less than so many samples; what lags more was filtered or computed
_PROMPT = 2
# an integrated angle holds nothing but the velocity
_INTEGRATED = 0.99
# even steps have to fit this much better than the stamps
_EVEN = 0.8
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
    the shaft says that the sampling was even and the stamps were not. `count_rad` and
    `tacho_step_rad_s` are the smallest steps that are seen.
    """

    time_s: FloatArray
    steps_s: FloatArray
    angle_rad: FloatArray
    velocity_rad_s: FloatArray
    moves_rad: FloatArray
    good: NDArray[np.bool_]
    count_rad: float
    tacho_step_rad_s: float
    names: tuple[str, str]

    @property
    def period_s(self) -> float:
        """Median sampling period, s."""
        return float(np.median(np.diff(self.time_s)))

    def by_velocity_rad(self) -> FloatArray:
        """Return the increments by the velocity, by the trapezoidal rule, rad."""
        mean = 0.5 * (self.velocity_rad_s[1:] + self.velocity_rad_s[:-1])
        return np.asarray(mean * self.steps_s)


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
    moves = np.diff(angle)
    good = np.isfinite(moves) & np.isfinite(velocity[1:]) & np.isfinite(velocity[:-1])
    good[gap_steps(trace.time_s)] = False
    sizes = np.unique(np.round(moves[np.isfinite(moves)], _DECIMALS))
    count = float(np.diff(sizes).min()) if len(sizes) > 1 else 0.0
    changes = np.abs(np.diff(velocity))
    changes = changes[changes > 0.0]
    step = float(changes.min()) if len(changes) else 0.0
    names = tuple(next(n for n in some if n in trace) for some in (ANGLES, VELOCITIES))
    return Shaft(
        trace.time_s, _true_steps(trace.time_s, moves, velocity, good), angle, velocity, moves,
        good, count, step, (names[0], names[1]),
    )  # fmt: skip


def _true_steps(
    time_s: FloatArray, moves: FloatArray, velocity: FloatArray, good: NDArray[np.bool_]
) -> FloatArray:
    """Return the steps of the stamps, or even ones where the angle's moves fit those better."""
    steps = np.diff(time_s)
    even = np.where(good, float(np.median(steps)), steps)
    pace = 0.5 * (velocity[1:] + velocity[:-1])
    off = [float(np.sum(np.abs(moves - pace * one)[good])) for one in (steps, even)]
    return even if off[1] < _EVEN * off[0] else steps


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


def _cells(values: FloatArray, delay: int, count: int) -> FloatArray:
    """Return the mean of values over each cell of samples around i + delay, one column each."""
    total = np.concatenate([[0.0], np.cumsum(values - values.mean())])
    at = np.arange(count) + delay
    reach = [total[np.clip(at + edge, 0, len(values))] for edge in _EDGES]
    widths = np.diff(_EDGES)
    means = [(b - a) / w for a, b, w in zip(reach, reach[1:], widths, strict=False)]
    return np.asarray(np.column_stack(means) + values.mean())


def _solved(design: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return the least squares' coefficients by the normal equations, columns at one size."""
    size = np.sqrt(np.mean(design**2, axis=0)) + 1e-300
    part = design / size
    gram = part.T @ part
    gram[np.diag_indices_from(gram)] *= 1.0 + 1e-10
    return np.asarray(np.linalg.lstsq(gram, part.T @ wanted, rcond=None)[0] / size)


def _delay(shaft: Shaft) -> int:
    """Return by how many samples the velocity lags behind the angle."""
    rate = _filled(np.where(shaft.good, shaft.moves_rad, np.nan)) / shaft.steps_s
    velocity = _filled(shaft.velocity_rad_s)[1:]
    most = min(DELAYS, len(rate) // 4)
    count = len(rate) - most
    off = [float(np.mean((velocity[k : k + count] - rate[:count]) ** 2)) for k in range(most)]
    best = int(np.argmin(off))
    # a delay has to show: at one speed every delay fits
    return best if off[best] < 0.9 * off[0] else 0


def disagreement(shaft: Shaft, *, free: bool) -> FloatArray:
    """Return increments of the angle that the velocity does not explain, rad.

    Gain, offset and lag of the velocity are none. With `free` the velocity is weighed freely over
    some samples on each side, so that its filter is none either, be it a tacho's or that of a
    velocity that was made of the angle.
    """
    good, wanted = shaft.good, shaft.moves_rad
    left = np.zeros(len(good))
    if int(good.sum()) < 8 * len(_EDGES):
        return left
    steps = shaft.steps_s
    velocity = _filled(shaft.velocity_rad_s)
    plain = 0.5 * (velocity[1:] + velocity[:-1]) * steps
    if free:
        cells = _cells(velocity, _delay(shaft), len(good)) * steps[:, None]
        design = np.column_stack([cells, steps])
    else:
        design = np.column_stack([plain, np.diff(velocity), steps])
    off = np.abs(wanted - plain)
    used = good & (off <= _TRIM * float(np.quantile(off[good], _USUAL)))
    for _ in range(_ROUNDS):
        solution = _solved(design[used], wanted[used])
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
    left = response - columns @ _solved(columns, response)
    return 1.0 - float(left @ left) / power


def has_own_noise(shaft: Shaft) -> bool:
    """Return whether the velocity shows noise above its rounding, and does not lag.

    Where it does not, or lags, nobody can see whether it is a sensor of its own.
    """
    velocity = _filled(shaft.velocity_rad_s)
    fast = robust_std(velocity - uniform_filter1d(velocity, _FAST))
    rounding = shaft.tacho_step_rad_s / float(np.sqrt(12.0))
    return fast > _OWN * rounding and _delay(shaft) <= _PROMPT


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
